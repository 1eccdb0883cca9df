"""What a point of the object tells: where it is, whose it is, its numbers and its plots."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from ..errors import SvbrdfError
from ..reflectance.density import highest_bell
from ..reflectance.history import History, history, peaks_of
from ..samples.luminance import luminance, to_srgb8
from . import maps
from .session import Session

SHOWN_TEXELS = 2000
"""Of a cluster, whose peaks make the density of ρs where no filter has computed them."""


def warm(session: Session) -> None:
    """Compute now what the first answers would wait for, and compile what they run."""
    with contextlib.suppress(SvbrdfError):  # it is said to whoever asks
        session.scene.graph.prepare()
        session.preview(session.threshold)
        texel = int(np.argmax(session.labels >= 0))
        plot_history(session, texel)
        plot_density(session, int(session.labels[texel]))
        maps.project_frame(session.scene, 0)


def hits(session: Session, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Where rays (R, 3) of the world first meet the object: (H, 3), those that miss left out."""
    return _meet(session, origins, directions)[0]


def loop(session: Session, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """A closed stroke: where rays first meet the object, and back along where they last leave it.

    It begins in the middle of the back, so that its middle is that of the front.
    """
    front = hits(session, origins, directions)
    origins, directions = np.reshape(origins, (-1, 3)), np.reshape(directions, (-1, 3))
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    away = np.linalg.norm(origins - session.scene.texels.center, axis=1, keepdims=True)
    beyond = origins + directions / length * (away + 2 * session.scene.texels.radius)
    back = hits(session, beyond, -directions)
    half = len(back) // 2
    return np.concatenate([back[:half][::-1], front, back[half:][::-1], back[half - 1 : half]])


def pick(session: Session, origin: np.ndarray, direction: np.ndarray) -> dict[str, Any]:
    """The texel under a ray, as JSON; SvbrdfError where the ray misses the object."""
    scene = session.scene
    points, faces = _meet(session, origin, direction)
    if not len(points):
        raise SvbrdfError("there is no object under the pointer: nothing was picked")
    texel = _nearest(session, points[0] - scene.texels.center, int(faces[0]))
    return tell(session, texel)


def tell(session: Session, texel: int) -> dict[str, Any]:
    """Numbers of a texel."""
    scene, labels = session.scene, session.labels
    cluster = int(labels[texel])
    told: dict[str, Any] = {
        "texel": texel,
        "point": scene.place(texel).tolist(),
        "normal": scene.texels.normal[texel].tolist(),
        "face": int(scene.texels.face[texel]),
        "cluster": cluster,
    }
    diffuse = scene.attribute("final_diffuse")
    diffuse = scene.attribute("diffuse") if diffuse is None else diffuse
    if diffuse is not None and np.isfinite(diffuse[texel]).all():
        told["diffuse"] = (diffuse[texel] / 100).tolist()
        told["diffuse_srgb"] = to_srgb8(diffuse[texel] / 100).tolist()
        told["luminance"] = float(luminance(diffuse[texel]))
    for name in ("threshold", "mean", "minimum", "samples", "frames", "rho_s", "alpha"):
        values = scene.attribute(name)
        if values is not None and np.isfinite(values[texel]):
            told[name] = float(values[texel])
    return told


def plot_history(session: Session, texel: int) -> dict[str, Any]:
    """The temporal plot of a texel, as JSON: samples, levels and peaks."""
    scene = session.scene
    observations = scene.observations
    level = scene.level
    diffuse = np.nan if level is None else float(level[texel])
    found = history(observations, texel, diffuse, scene.lights, by_direction=scene.by_direction)
    threshold = scene.attribute("threshold")
    return {
        "frame": found.frame.tolist(),
        "label": [scene.frames[f] for f in found.frame],
        "frames": len(scene.frames),
        "luminance": _round(found.luminance),
        "quality": _round(found.quality),
        "clipped": found.clipped.tolist(),
        "diffuse": None if np.isnan(diffuse) else diffuse,
        "threshold": None if threshold is None else _number(threshold[texel]),
        "peaks": _peaks(found),
        "lights": len(scene.lights),
    }


def plot_density(session: Session, cluster: int) -> dict[str, Any]:
    """The density of ln ρs of a cluster's texels and the bell of its highest mode, as JSON."""
    with session.lock:
        own = np.flatnonzero(session.labels == cluster)
    scene = session.scene
    rho_s, alpha = scene.attribute("rho_s"), scene.attribute("alpha")
    if rho_s is not None and alpha is not None:
        rho, shininess, asked = rho_s[own] * 100, alpha[own], len(own)
    else:
        if scene.level is None or not scene.lights:
            raise SvbrdfError("no lights were found yet: run compute_svbrdf_light_sources")
        some = own[np.linspace(0, len(own) - 1, min(len(own), SHOWN_TEXELS)).astype(int)]
        some, asked = np.unique(some), len(some)
        rho, shininess = peaks_of(
            scene.observations, some, scene.level[some], scene.lights,
            by_direction=scene.by_direction,
        )  # fmt: skip
    known = int((np.isfinite(rho) & np.isfinite(shininess)).sum())
    told: dict[str, Any] = {"cluster": cluster, "asked": int(asked), "known": known, "bell": None}
    bell = highest_bell(rho, shininess)
    if bell is not None and np.isfinite(bell.density).all():
        told["bell"] = {
            "rho_s": bell.rho_s / 100, "alpha": bell.alpha, "low": bell.low / 100,
            "high": bell.high / 100, "texels": bell.texels,
            "x": _round(bell.x[::4] / 100), "density": _round(bell.density[::4]),
        }  # fmt: skip
    return told


def _meet(session: Session, origins: np.ndarray, directions: np.ndarray):
    """World points (H, 3) and faces (H,) that rays first meet."""
    rays = session.scene.rays
    origins = np.asarray(origins, float).reshape(-1, 3)
    directions = np.asarray(directions, float).reshape(-1, 3)
    good = np.isfinite(origins).all(1) & np.isfinite(directions).all(1) & directions.any(1)
    if len(origins) != len(directions) or not good.all():
        raise SvbrdfError("a ray is an origin and a direction of three finite numbers each")
    if not len(origins):
        return np.zeros((0, 3)), np.zeros(0, int)
    face, barycentric, _ = rays.nearest(origins - rays.center, directions)
    hit = face >= 0
    corners = session.scene.mesh.vertices[session.scene.mesh.faces[face[hit]]]
    return np.einsum("hc,hcd->hd", barycentric[hit], corners), face[hit]


def _nearest(session: Session, point: np.ndarray, face: int) -> int:
    """The texel at a point about the centre: of the same face where it has one, so that the back of
    a thin sheet is not taken for its front."""
    scene = session.scene
    near = scene.graph.tree.query(point, k=min(16, len(scene.texels)))[1]
    near = np.atleast_1d(near)
    same = near[scene.texels.face[near] == face]
    if len(same):
        return int(same[0])
    corners = scene.mesh.vertices[scene.mesh.faces[face]]
    front = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    facing = near[scene.texels.normal[near] @ front * scene.mesh.winding() > 0]
    return int(facing[0] if len(facing) else near[0])


def _peaks(found: History) -> list[dict[str, Any]]:
    return [
        {
            "samples": peak.samples.tolist(), "light": peak.light, "c_max": peak.c_max,
            "c_min": peak.c_min, "distance": _number(peak.distance),
            "rho_s": _number(peak.rho_s / 100), "alpha": _number(peak.alpha),
        }
        for peak in found.peaks
    ]  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _round(values: np.ndarray) -> list[float]:
    return [float(f"{x:.5g}") for x in values]
