"""How near a result comes to a scene's truth: lights, diffuse colour, materials, unseen views.

A highlight cannot tell a lamp's size from the lobe: ρs and α are compared with a truth widened
by the lamps' variance, 1/α_seen = 1/α + σ²; where lamps differ in size or are long, with the range
from the truth widened by the largest variance to that by the least.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from meshlab_svbrdf.document.images import read_exr, read_image
from meshlab_svbrdf.samples.luminance import decode

from .score_environment import environment
from .score_views import unseen_views

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it warns of its optional dependencies
    import colour

SAME_LIGHT = 10.0  # degrees
_FIVE = np.ones((5, 5), np.uint8)
DIVISOR = {"disk": 4, "rectangle": 3}  # a uniform disk's variance is r²/4, a bar's a²/3
Scores = dict[str, Any]


def score(result: Path, truth: Path, rendered: Path, center: np.ndarray) -> Scores:
    """All figures of one result.

    result : NAME.svbrdf; truth : ground_truth; rendered : folder of the views' renderings;
    center : (3,), of the mesh
    """
    figures = lights(result, truth, center) | environment(result, truth) | diffuse(result, truth)
    figures |= materials(result, truth) | clusters(result, truth)
    return figures | unseen_views(rendered, truth)


def lights(result: Path, truth: Path, center: np.ndarray) -> Scores:
    """Angles as seen from the centre, gains relative to each other, distances."""
    emitters = _json(truth / "lights.json")["emitters"]
    found = _json(result / "lights.json")["lights"]
    expected = np.array([e["position"] for e in emitters]) - center
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    offsets = [
        np.array(f["direction"]) if f["position"] is None else np.array(f["position"]) - center
        for f in found
    ]
    rays = np.array([o / np.linalg.norm(o) for o in offsets]).reshape(-1, 3)
    angles = np.degrees(np.arccos(np.clip(expected @ rays.T, -1, 1)))
    i, j = linear_sum_assignment(np.minimum(angles, 3 * SAME_LIGHT))
    same = angles[i, j] < SAME_LIGHT
    i, j = i[same], j[same]
    error = angles[i, j]
    gain = np.log(
        [
            found[b]["gain"] / np.mean(emitters[a]["phong_intensity"])
            for a, b in zip(i, j, strict=True)
        ]
    )
    return {
        "lights_missed": len(emitters) - len(i),
        "lights_false": len(found) - len(j),
        "light_deg": float(error.mean()) if len(i) else None,
        "light_deg_max": float(error.max()) if len(i) else None,
        "ln_gain_max": float(np.abs(gain - gain.mean()).max()) if len(i) > 1 else None,
    }


def diffuse(result: Path, truth: Path) -> Scores:
    """CIEDE2000 at the truth's resolution, where the map is observed and the truth not clipped."""
    shaded = read_exr(truth / "diffuse_shaded.exr").astype(np.float64)
    size = shaded.shape[1::-1]
    inside = _shrink((read_image(truth / "texel_mask.png") > 127).astype(float), size) > 0.999
    inside &= np.isfinite(shaded).all(-1) & (shaded.max(-1) < 1)
    found = read_exr(result / "maps" / "diffuse.exr").astype(np.float64)
    valid = np.isfinite(found).all(-1) & (read_image(result / "maps" / "valid.png") > 127)
    weight = _shrink(valid.astype(float), size)
    mean = _shrink(np.where(valid[..., None], found, 0), size)
    seen = inside & (weight > 0.5)
    if not seen.any():
        return {"coverage": None, "dE_mean": None, "dE_median": None, "dE_p95": None}
    error = colour.delta_E(_lab(mean[seen] / weight[seen][:, None]), _lab(shaded[seen]))
    return {
        "coverage": float(seen.sum() / inside.sum()),
        "dE_mean": float(error.mean()),
        "dE_median": float(np.median(error)),
        "dE_p95": float(np.quantile(error, 0.95)),
    }


def albedo(found: Path, truth: Path) -> Scores:
    """CIEDE2000 of a map against the true albedo at its resolution, one linear scale fitted."""
    true = decode(read_image(truth / "albedo.png")[..., :3] / 255)
    image = read_exr(found).astype(np.float64)
    size = tuple(min(a, b) for a, b in zip(image.shape[1::-1], true.shape[1::-1], strict=True))
    inside = _shrink((read_image(truth / "texel_mask.png") > 127).astype(float), size) > 0.999
    known = np.isfinite(image).all(-1)
    weight = _shrink(known.astype(float), size)
    mean, true = _shrink(np.where(known[..., None], image, 0), size), _shrink(true, size)
    seen = inside & (weight > 0.5)
    if not seen.any():
        return {"coverage": None, "dE_mean": None, "dE_median": None}
    a, b = mean[seen] / weight[seen][:, None], true[seen]
    error = colour.delta_E(_lab(a * (a * b).sum() / (a * a).sum()), _lab(b))
    return {
        "coverage": float(seen.sum() / inside.sum()),
        "dE_mean": float(error.mean()),
        "dE_median": float(np.median(error)),
    }


def materials(result: Path, truth: Path) -> Scores:
    """Per true material: ln of estimate over truth, where the truth is a Phong lobe.

    A material without a lobe on more than half of the texels that were seen is infinitely wrong.
    """
    described = _json(truth / "materials.json")["materials"]
    least, most = (seen_lobes(truth, of)[0] for of in (np.max, np.min))
    rho_s, alpha = (read_exr(result / "maps" / f"{name}.exr") for name in ("rho_s", "alpha"))
    ids, inside = like_truth(rho_s, truth)
    inside &= read_image(result / "maps" / "valid.png") > 127
    rows = []
    for m, low, high in zip(described, least, most, strict=True):
        own = cv2.erode(((ids == m["id"]) & inside).astype(np.uint8), _FIVE) > 0
        seen = own & np.isfinite(rho_s) & np.isfinite(alpha) & (rho_s > 0)
        row: Scores = {"name": m["name"], "observed": float(seen.sum() / max(own.sum(), 1))}
        rows.append(row)
        if row["observed"] >= 0.5:
            row |= {"rho_s": float(np.median(rho_s[seen])), "alpha": float(np.median(alpha[seen]))}
        if not m["rho_s"]:
            continue
        for k, name in enumerate(("rho_s", "alpha")):
            row[f"{name}_true"] = [low[k], high[k]]
            value = row.get(name, math.inf)
            row[f"ln_{name}"] = math.log(value / min(max(value, low[k]), high[k]))
    glossy = [row for row in rows if "ln_rho_s" in row]
    return {
        "materials": rows,
        "ln_rho_s_worst": _worst(row["ln_rho_s"] for row in glossy),
        "ln_alpha_worst": _worst(row["ln_alpha"] for row in glossy),
    }


def seen_lobes(
    truth: Path, of: Callable[..., Any] = np.mean
) -> tuple[list[tuple[float, float]], float]:
    """Each material's true (ρs, α) as seen, for a light of gain 1, and the intensity of such a one.

    of : which of all the lamps' variances widens the truth. ρs is 0 where there is no lobe of
    Phong's.
    """
    emitters = _json(truth / "lights.json")["emitters"]
    variances = [np.radians(e["half_extent_deg"]) ** 2 / DIVISOR[e["kind"]] for e in emitters]
    gain = float(np.exp(np.mean([np.log(np.mean(e["phong_intensity"])) for e in emitters])))
    lobes = []
    for m in _json(truth / "materials.json")["materials"]:
        alpha = m["alpha"] or 1.0
        seen = 1 / (1 / alpha + float(of(variances)))
        lobes.append(((m["rho_s"] or 0.0) * gain * seen / alpha, seen))
    return lobes, gain


def _worst(errors: Iterable[float]) -> float | None:
    return max(errors, key=abs, default=None)


def clusters(result: Path, truth: Path) -> Scores:
    """How many, the share of the surface that has a label, and the labels' adjusted Rand index."""
    label = read_image(result / "maps" / "material.png")
    ids, inside = like_truth(label, truth)
    labelled = inside & (label < np.iinfo(label.dtype).max)
    truly, found = (np.where(labelled, a.astype(int), -1).ravel() for a in (ids, label))
    return {
        "clusters": len(np.unique(label[labelled])),
        "labelled": float(labelled.sum() / max(inside.sum(), 1)),
        "adjusted_rand": adjusted_rand(truly, found),
    }


def adjusted_rand(a: np.ndarray, b: np.ndarray) -> float:
    """Of two labellings (N,) int where both are at least 0: 1 alike, 0 as by chance (Hubert and
    Arabie 1985)."""
    both = (a >= 0) & (b >= 0)
    table = np.zeros((a.max(initial=0) + 1, b.max(initial=0) + 1))
    np.add.at(table, (a[both], b[both]), 1)

    def pairs(x: np.ndarray) -> float:
        return float((x * (x - 1) / 2).sum())

    rows, columns, total = pairs(table.sum(1)), pairs(table.sum(0)), pairs(table.sum())
    chance = rows * columns / max(total, 1)
    return (pairs(table) - chance) / max((rows + columns) / 2 - chance, 1e-12)


def like_truth(image: np.ndarray, truth: Path) -> tuple[np.ndarray, np.ndarray]:
    """The true material ids and the charts' mask at the image's size."""
    size = image.shape[1::-1]
    ids, mask = (
        cv2.resize(read_image(truth / f"{name}.png"), size, interpolation=cv2.INTER_NEAREST)
        for name in ("material_id", "texel_mask")
    )
    return ids, mask > 127


def _lab(linear: np.ndarray) -> np.ndarray:
    return colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(linear, 0, 1), "sRGB"))


def _shrink(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
