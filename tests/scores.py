"""How far a result is from the truth beside a scene: lights, diffuse colour, gloss, views."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from analytic import angle, unit
from scipy.optimize import linear_sum_assignment

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # that its plots need matplotlib
    import colour

KERNEL = np.ones((5, 5), np.uint8)


@dataclass(frozen=True)
class LightScore:
    """angle : degrees as seen from the centre; ln_gain : about the mean; ln_distance : near ones.

    Each the worst of the lights that were found (within 10°).
    """

    missed: int
    false: int
    angle: float
    ln_gain: float
    ln_distance: float


def _truth(truth: Path, name: str) -> list[dict]:
    record = json.loads((truth / f"{name}.json").read_text())
    return record["emitters" if name == "lights" else name]


def true_gain(truth: Path) -> float:
    """The intensity of a light of gain 1: the lights' geometric mean."""
    return float(
        np.exp(np.mean(np.log([e["phong_intensity"][0] for e in _truth(truth, "lights")])))
    )


def lights(document: Document, truth: Path) -> LightScore:
    """Every true light with the one found that is nearest; a near one by where it stands."""
    center, radius = document.mesh().center, document.mesh().radius
    true, found = _truth(truth, "lights"), document.json("lights")["lights"]

    def offset(light: dict) -> np.ndarray:
        place = light["position"]
        far = 1e6 * radius * np.array(light["direction"])
        return far if place is None else np.array(place) - center

    expected, got = np.array([offset(e) for e in true]), np.array([offset(e) for e in found])
    apart = angle(unit(expected)[:, None], unit(got)[None])
    i, j = linear_sum_assignment(np.minimum(apart, 30))
    i, j = i[apart[i, j] < 10], j[apart[i, j] < 10]
    gain = np.log([found[b]["gain"] / true[a]["phong_intensity"][0] for a, b in zip(i, j)])  # noqa: B905
    distance = np.linalg.norm(got[j], axis=1) / np.linalg.norm(expected[i], axis=1)
    return LightScore(
        len(true) - len(i), len(found) - len(i), apart[i, j].max(),
        np.abs(gain - gain.mean()).max(), np.abs(np.log(distance)).max(),
    )  # fmt: skip


def diffuse(document: Document, truth: Path) -> np.ndarray:
    """CIEDE2000 of the diffuse colour, where it and its truth are known and not clipped, (n,)."""
    true = read_exr(truth / "diffuse_shaded.exr").astype(np.float64)
    shrink = lambda image: cv2.resize(image, true.shape[1::-1], interpolation=cv2.INTER_AREA)  # noqa: E731
    inside = shrink((read_image(truth / "texel_mask.png") > 127).astype(float)) > 0.999
    inside &= np.isfinite(true).all(-1) & (true.max(-1) < 1)
    got = document.map("diffuse")[0].astype(np.float64)
    observed = np.isfinite(got).all(-1)
    weight = shrink(observed.astype(float))
    seen = inside & (weight > 0.5)
    assert seen.sum() > 0.8 * inside.sum()
    mean = shrink(np.where(observed[..., None], got, 0))[seen] / weight[seen][:, None]
    return colour.delta_E(_lab(mean), _lab(true[seen]))


def _lab(linear: np.ndarray) -> np.ndarray:
    return colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(linear, 0, 1), "sRGB"))


@dataclass(frozen=True)
class Gloss:
    """observed : share of the material's texels; the others of their medians, NaN where none."""

    observed: float
    ln_rho_s: float
    ln_alpha: float


def gloss(document: Document, truth: Path) -> dict[str, Gloss]:
    """By material, off its borders; the truth widened by the lamps' size, as highlights show it."""
    lamps = _truth(truth, "lights")
    spread = np.mean([np.mean(np.radians(e["half_extent_deg"]) ** 2) / 4 for e in lamps])
    rho_s, alpha = document.map("rho_s")[0], document.map("alpha")[0]
    size = rho_s.shape[::-1]
    ids, mask = (
        cv2.resize(read_image(truth / name), size, interpolation=cv2.INTER_NEAREST)
        for name in ("material_id.png", "texel_mask.png")
    )
    scores = {}
    for material in _truth(truth, "materials"):
        own = cv2.erode(((ids == material["id"]) & (mask > 127)).astype(np.uint8), KERNEL) > 0
        seen = own & np.isfinite(rho_s)
        errors = [np.nan, np.nan]
        if seen.any() and material["rho_s"] > 0:
            wide = 1 / (1 / material["alpha"] + spread)
            true = material["rho_s"] * true_gain(truth) * wide / material["alpha"]
            errors = [np.log(np.median(rho_s[seen]) / true), np.log(np.median(alpha[seen]) / wide)]
        scores[material["name"]] = Gloss(float(seen.sum() / own.sum()), *errors)
    return scores


def psnr(image: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """dB of 8-bit sRGB pictures over the object's pixels, and over the brightest tenth of them.

    The object is what was rendered before the even grey of the picture's corner, off silhouettes.
    """
    shown = (image != image[0, 0]).any(-1).astype(np.uint8)
    on = cv2.erode(cv2.morphologyEx(shown, cv2.MORPH_CLOSE, KERNEL), KERNEL) > 0
    error = ((image[on].astype(float) - true[on]) ** 2).mean(-1)
    bright = true[on].mean(-1)
    high = error[bright >= np.quantile(bright, 0.9)]
    return 10 * np.log10(255**2 / error.mean()), 10 * np.log10(255**2 / high.mean())
