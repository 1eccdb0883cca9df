"""What may be painted on the object: a colour for every texel, and a legend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import SvbrdfError
from ..jit import kernel
from ..rendering.colors import scale_of, viridis
from ..samples.luminance import to_srgb8
from .scene import Scene

UNOBSERVED = np.array([58, 61, 66], np.uint8)
MAPS = {
    "diffuse": "diffuse colour",
    "materials": "materials",
    "rho_s": "ρs of the material",
    "alpha": "α of the material (shininess)",
    "roughness": "roughness of the material, where microfacets describe it",
    "texel_rho_s": "ρs of the texel's own peak",
    "texel_alpha": "α of the texel's own peak",
    "threshold": "luminance threshold",
    "samples": "samples per texel",
    "confidence": "confidence: variance explained",
    "frame": "a frame of the video",
}
LOGARITHMIC = ("alpha", "texel_alpha")


@dataclass(frozen=True)
class Shown:
    """colors : (T, 3) uint8 sRGB; legend : of a scale, {"low", "high", "unit", "log"}, or {}"""

    colors: np.ndarray
    legend: dict[str, Any]


def available(scene: Scene) -> list[dict[str, str]]:
    """The maps that this project can show: name and title."""
    has = {
        "diffuse": scene.attribute("diffuse") is not None,
        "materials": True,
        "frame": bool(scene.frames),
    }
    return [
        {"name": name, "title": title}
        for name, title in MAPS.items()
        if has.get(name, name not in has and _scalar(scene, name) is not None)
    ]


def paint(scene: Scene, name: str, frame: int = 0) -> Shown:
    """A map's colours; SvbrdfError where the project does not have it. `materials` has none: pages
    colour the labels themselves."""
    if name == "frame":
        return Shown(project_frame(scene, frame), {})
    with scene.painting:
        if name not in scene.painted:
            scene.painted[name] = _paint(scene, name)
        return scene.painted[name]


def _paint(scene: Scene, name: str) -> Shown:
    if name == "diffuse":
        diffuse = scene.attribute("final_diffuse")
        diffuse = scene.attribute("diffuse") if diffuse is None else diffuse
        if diffuse is None:
            raise SvbrdfError("the project has no diffuse colour yet")
        known = np.isfinite(diffuse).all(1)
        colors = to_srgb8((diffuse / 100).astype(np.float32))
        return Shown(np.where(known[:, None], colors, UNOBSERVED), {})
    values = _scalar(scene, name) if name in MAPS else None
    if values is None:
        raise SvbrdfError(f"the project has no map {name!r}")
    return _scale(values, logarithmic=name in LOGARITHMIC)


def project_frame(scene: Scene, frame: int) -> np.ndarray:
    """The frame's samples on the texels (T, 3), as filters read them; unobserved elsewhere."""
    scene.check_frame(frame)
    store = scene.observations.store
    colors = np.broadcast_to(UNOBSERVED, (len(scene.texels), 3)).copy()
    for first, chunk in store.placed():
        if first <= frame < first + chunk.frames:
            offsets, frames = chunk.mapped("offsets"), chunk.mapped("frame")
            _project(offsets, frames, chunk.mapped("value"), np.uint8(frame - first), colors)
    return colors


@kernel
def _project(offsets, frames, values, frame, colors):
    for i in range(len(colors)):
        for j in range(offsets[i], offsets[i + 1]):
            if frames[j] == frame:
                for c in range(3):
                    colors[i, c] = values[j, c]


def _scalar(scene: Scene, name: str) -> np.ndarray | None:
    """A map's values (T,), NaN where unobserved."""
    if name == "rho_s":
        return scene.attribute("material_rho_s")
    if name == "alpha":
        return scene.attribute("material_alpha")
    if name == "roughness":
        return scene.attribute("material_roughness")
    if name in ("texel_rho_s", "texel_alpha"):
        return scene.attribute(name.removeprefix("texel_"))
    if name == "threshold":
        return scene.attribute("threshold")
    if name == "samples":
        counts = scene.attribute("samples")
        return None if counts is None else np.where(counts > 0, counts, np.nan)
    if name == "confidence":
        told = {
            k: entry["explained_variance"]
            for k, entry in scene.glosses.items()
            if entry.get("explained_variance") is not None and entry["observed"]
        }
        if not told:
            return None
        table = np.full(max(int(scene.labels.max(initial=-1)), *told) + 2, np.nan)
        table[list(told)] = list(told.values())
        return table[scene.labels]
    return None


def _scale(values: np.ndarray, *, logarithmic: bool) -> Shown:
    known, scale = np.isfinite(values), scale_of(values, logarithmic)
    colors = viridis(scale.share(np.where(known, values, scale.low)))
    return Shown(np.where(known[:, None], colors, UNOBSERVED), scale._asdict())
