"""What the accuracy tables say, in sentences: counts and worst cases, from the same rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from statistics import median

from .ledger import Row

TRUE = "joint, true materials"


def sentences(rows: Sequence[Row]) -> list[str]:
    """One for each question; questions that the rows do not answer are left out."""
    scenes: dict[str, dict[str, Row]] = {}
    for row in rows:
        if "error" not in row and "skipped" not in row:
            scenes.setdefault(row["scene"], {})[row["name"]] = row
    found = [_lights(scenes), _gloss(scenes, "ln_rho_s_worst", "ρs")]
    found += [_gloss(scenes, "ln_alpha_worst", "α")]
    found.append(_highlights(scenes, "paper", "above `paper`", 1))
    found.append(_highlights(scenes, "truth", "below the truth rendered the same way", -1))
    peers = dict.fromkeys(
        name for own in scenes.values() for name, row in own.items() if _peer(row)
    )
    found += [_diffuse(scenes, name) for name in peers]
    return [sentence for sentence in found if sentence]


def _peer(row: Row) -> bool:
    return "lights_missed" not in row and "dE_mean" in row


def _lights(scenes: Mapping[str, Mapping[str, Row]]) -> str:
    joint = {scene: own["joint"] for scene, own in scenes.items() if "joint" in own}
    if not joint:
        return ""
    odd = [s for s, row in joint.items() if row["lights_missed"] or row["lights_false"]]
    words = f"Lights: all found and no other on {len(joint) - len(odd)} of {len(joint)} scenes"
    words += f" (not on {', '.join(odd)})" if odd else ""
    angle = {s: row["light_deg"] for s, row in joint.items() if row["light_deg"] is not None}
    return words + (f"; {_spread(angle, '{:.2f}°', max)}." if angle else ".")


def _gloss(scenes: Mapping[str, Mapping[str, Row]], key: str, name: str) -> str:
    error = {
        scene: abs(float(own[TRUE][key]))
        for scene, own in scenes.items()
        if TRUE in own and own[TRUE].get(key) is not None and "truth" in own
    }
    if not error:
        return ""
    return (
        f"|ln {name}| of the worst material, given the materials: {_spread(error, '{:.3f}', max)}."
    )


def _highlights(scenes: Mapping[str, Mapping[str, Row]], other: str, words: str, sign: int) -> str:
    gap = {
        scene: sign * (own["joint"]["psnr_highlights"] - own[other]["psnr_highlights"])
        for scene, own in scenes.items()
        if "joint" in own and other in own
    }
    worst = min if sign > 0 else max
    return f"Highlights, {words}: {_spread(gap, '{:.1f} dB', worst)}." if gap else ""


def _diffuse(scenes: Mapping[str, Mapping[str, Row]], peer: str) -> str:
    """Mean ΔE of `joint` as a share of the peer's."""
    ratio = {
        scene: own["joint"]["dE_mean"] / own[peer]["dE_mean"]
        for scene, own in scenes.items()
        if "joint" in own and own["joint"].get("dE_mean") and own.get(peer, {}).get("dE_mean")
    }
    if not ratio:
        return ""
    below, half = sum(r < 1 for r in ratio.values()), sum(r < 0.5 for r in ratio.values())
    return (
        f"ΔE against `{peer}`: less on {below} of {len(ratio)} scenes, less than half on {half}; "
        f"{_spread(ratio, '{:.0%}', max)} of its."
    )


def _spread(values: Mapping[str, float], form: str, worst: Callable) -> str:
    """The middle scene, and the worst one by name."""
    last = worst(values, key=lambda name: values[name])
    middle = form.format(median(values.values()))
    return f"{middle} in the middle, at worst {form.format(values[last])} ({last})"
