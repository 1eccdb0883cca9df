"""Run time against error: presets, and what each of their knobs does alone.

Every run is cold: it starts from the frames. Two groups, environment size and visibility, go on
from the samples of the plain result, and count what these took.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from meshlab_svbrdf.presets import PRESETS

from .cases import Case
from .ledger import Ledger, Row, Task
from .solve import TEXTURE, Setup, judge, solve
from .tables import Column, Table, table

PART = "time"
STEP, HEIGHT = "compute_svbrdf_samples.step", "generate_svbrdf_environment_map.height"
VISIBILITY, BANDS = "compute_svbrdf_visibility.mode", "compute_svbrdf_visibility.bands"
DIRECTIONS = "compute_svbrdf_visibility.directions"
SHADOWS = "compute_svbrdf_material_specular.shadows"
PRESET, FRAMES, TEXELS, ENVIRONMENT, SHADOW, PAPER, PEER = (
    "preset", "frames", "texels", "environment", "visibility", "paper", "peer",
)  # fmt: skip
EIGHTH = "standard, 1 frame in 8"
COLUMNS = (
    Column("s", "seconds", "{:.1f}"),
    Column("CPU s", "cpu_seconds", "{:.1f}"),
    Column("light °", "light_deg", "{:.2f}"),
    Column("ln ρs", "ln_rho_s_worst", "{:+.3f}"),
    Column("ln α", "ln_alpha_worst", "{:+.3f}"),
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("median", "dE_median", "{:.2f}"),
    Column("dB", "psnr", "{:.1f}"),
    Column("highlights", "psnr_highlights", "{:.1f}"),
)


def setups(texture: int) -> dict[str, tuple[str, Setup, bool]]:
    """By name: group, configuration, and whether it goes on from the plain result (or is that).

    texture : texels of the plain result, and of all that changes one knob of it
    """

    def knob(**settings: int | str) -> Setup:
        return Setup(texture=texture, settings={k: str(v) for k, v in settings.items()})

    found = {name: (PRESET, Setup(preset=name), False) for name in PRESETS}
    found[EIGHTH] = (FRAMES, Setup(settings={STEP: "8"}), False)
    found[f"{texture} texels"] = (TEXELS, knob(), True)
    others = {256, 512} - {texture}
    found |= {f"{n} texels": (TEXELS, knob(**{TEXTURE: n}), False) for n in sorted(others)}
    found |= {f"1 frame in {n}": (FRAMES, knob(**{STEP: n}), False) for n in (2, 4, 8, 16)}
    found |= {f"{n} rows": (ENVIRONMENT, knob(**{HEIGHT: n}), True) for n in (32, 64, 256)}
    found["no visibility"] = (SHADOW, knob(**{VISIBILITY: "never"}), True)
    found |= {f"{n} bands": (SHADOW, knob(**{BANDS: n}), True) for n in (2, 3)}
    found |= {f"{n} directions": (SHADOW, knob(**{DIRECTIONS: n}), True) for n in (32, 512)}
    found["6 bands, no rays"] = (SHADOW, knob(**{SHADOWS: "harmonics"}), True)
    found["paper"] = (PAPER, Setup("paper", texture=texture), True)
    return found


def tasks(
    ledger: Ledger,
    case: Case,
    texture: int,
    peers: Sequence[str] = (),
    minutes: float = 10,
) -> list[Task]:
    """minutes : that the peer which gets better all the time may take"""
    found = []
    for name, (group, setup, onward) in setups(texture).items():
        make = partial(_measure, ledger, case, group, setup, onward)
        found.append(Task(PART, case.name, name, repr(setup), make))
    for name in peers:
        make = partial(_peer, ledger, case, name, texture, minutes)
        about = f"peer, {texture} texels, {minutes} min"
        found.append(Task(PART, case.name, name, about, make))
    return found


def _plain(ledger: Ledger, case: Case, texture: int):
    return solve(case, Setup(texture=texture), ledger.work / PART / "base" / case.name)


def _measure(
    ledger: Ledger, case: Case, group: str, setup: Setup, onward: bool, folder: Path
) -> Row:
    start = None
    if onward:
        assert setup.texture is not None
        start = _plain(ledger, case, setup.texture).document.path.parent
    return judge(case, solve(case, setup, folder, start), folder) | {"group": group}


def _peer(ledger: Ledger, case: Case, name: str, texture: int, minutes: float, folder: Path) -> Row:
    from .peers import peer_scores  # some need packages that the rest does not

    document = _plain(ledger, case, texture).document
    size = int(document.texels().sizes[0][0])
    scores = peer_scores(
        case.path, document.folder, case.truth, size, folder, [name], minutes=minutes
    )
    return scores[name] | {"group": PEER}


def tables(rows: Sequence[Row]) -> list[Table]:
    """One table a scene; what no other row beats in both time and error is starred."""
    made, rows = [], over_time(rows)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == scene]
        fronts = [front(own, key, sign) for key, sign in (("dE_mean", 1), ("psnr_highlights", -1))]
        marked = [
            row | {"name": row["name"] + " †" * any(row["name"] in names for names in fronts)}
            for row in own
        ]
        made.append(
            table(scene, marked, COLUMNS, "† no faster run is better", eighth(own), scene=False)
        )
    return made


def over_time(rows: Iterable[Row]) -> list[Row]:
    """The rows, with one for each time at which a peer was looked at."""
    found: list[Row] = []
    for row in rows:
        looks = row.get("over_time") or [row]
        found += [
            row
            | look
            | ({"name": f"{row['name']} {look['seconds']:.0f} s"} if len(looks) > 1 else {})
            for look in looks
        ]
    return found


def front(rows: Sequence[Row], key: str, sign: int) -> list[str]:
    """Names of the rows that no faster row equals, by time. sign : 1 where less is better."""
    best, names = float("inf"), []
    usable = [row for row in rows if row.get(key) is not None and "seconds" in row]
    for row in sorted(usable, key=lambda row: row["seconds"]):
        if sign * row[key] < best:
            best = sign * row[key]
            names.append(row["name"])
    return names


def eighth(rows: Sequence[Row]) -> str:
    """What one frame in eight loses in the highlights, in words."""
    named = {row["name"]: row.get("psnr_highlights") for row in rows}
    whole, part = named.get("standard"), named.get(EIGHTH)
    if whole is None or part is None:
        return ""
    return f"One frame in eight: {part - whole:+.1f} dB in the highlights."
