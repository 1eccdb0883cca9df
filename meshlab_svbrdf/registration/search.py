"""The camera whose view of the geometry tells most about a frame, searched from coarse to fine."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ..geometry.camera import Camera
from .contrast import to_grey
from .mutual_information import Comparison, Shape, face_predictors, simplified
from .outlines import fit_outline
from .overlay import Edges, feature_edges
from .surface import Surface

SIZES = (30, 60, 120)  # pixels of the object's radius: where it is looked for, and each step
FINE = 240  # the same, where lines are looked for
REACH = 0.09  # radians, or share of the distance, by which a start may be off
TURNS = 100  # views of the object that are laid over the frame wherever it may be
APART = 2  # pixels between those places
CELL = 2.0  # pixels, within which vertices become one
PLACES = 3  # of each that are looked at again
KEPT = (24, 8)  # of all, that each step improves
AGREE = 0.02  # of the object's radius in the frame, within which two places are one
NEAREST = 3.0  # pixels; the same, where the object is small
AHEAD = 0.02  # nats a pixel, by which there must be more than without an object
HOLD = 3.0  # pixels at FINE, by which the last step's cameras may be wrong
AGREED = 0.45  # share of the geometry's lines that the frame must have, or it may be elsewhere
APART_BY = 0.1  # by which the share of another place must be less


class Refined(NamedTuple):
    """camera, score (information, nats a pixel), converged: whether it can be relied on."""

    camera: Camera
    score: float
    converged: bool


class _Motions:
    """Cameras around one, by numbers that are independent: whichever changes by d moves what is
    seen of the object by d pixels, RMS.

    A turn about the object's centre looks much like a shift. In these numbers what tells them apart
    weighs as much as what they share.
    """

    def __init__(self, camera: Camera, points: np.ndarray, free_focal: bool) -> None:
        self.camera, self.points, self.free_focal = camera, points, free_focal
        self.directions = np.eye(6 + free_focal)
        unit = 1e-4
        here = camera.project(points)[:, :2]
        slopes = [
            (self(unit * axis).project(points)[:, :2] - here).ravel() / unit
            for axis in self.directions
        ]
        gram = np.array(slopes) @ np.array(slopes).T / len(points)
        values, vectors = np.linalg.eigh(gram)
        # What moves nothing is left alone
        values = np.maximum(values, 1e-6 * values[-1])
        self.directions = (vectors / np.sqrt(values)).T

    def __call__(self, numbers: np.ndarray) -> Camera:
        n, c = np.asarray(numbers) @ self.directions, self.camera
        turned = Rotation.from_rotvec(n[:3]).as_matrix() @ c.R
        t = c.t + c.t[2] * n[3:6]
        longer = np.exp(n[6]) if self.free_focal else 1.0
        return replace(c, R=turned, t=t, fx=c.fx * longer, fy=c.fy * longer)


def settle(
    image: np.ndarray, camera: Camera, surface: Surface, edges: Edges, free_focal: bool = False
) -> tuple[Camera, float]:
    """A camera that is right but for a few pixels, moved to where the geometry's lines are the
    frame's, and the share of them that are; in the scaled world.

    image : (h, w) uint8
    """
    share = 0.0
    rim = camera.fx / max(camera.t[2], 1e-9)
    for times in sorted({max(round(rim / FINE), 1), 1}, reverse=True):
        h, w = (n // times for n in image.shape)
        small = cv2.resize(image[: h * times, : w * times], (w, h), interpolation=cv2.INTER_AREA)
        inner = replace(camera.reduced(times), width=w, height=h)
        inner, share = fit_outline(small, inner, surface, edges, HOLD, free_focal)
        camera = replace(
            camera, R=inner.R, t=inner.t, fx=inner.fx * times, fy=inner.fy * times
        )  # fmt: skip
    return camera, share


class InformationSearch:
    """`refine_camera` for many frames of one surface; cameras in the world."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        whole = Shape(surface.vertices, surface.faces, face_predictors(surface))
        self.shapes = [simplified(whole, CELL / size) for size in SIZES]
        self.edges = feature_edges(surface.vertices, surface.faces)

    def refine(self, image: np.ndarray, camera: Camera, free_focal: bool = False) -> Refined:
        """See `refine_camera`."""
        if image.shape[:2] != (camera.height, camera.width):
            raise ValueError(
                f"image: expected {camera.width}×{camera.height} as the camera says, "
                f"not {image.shape[1]}×{image.shape[0]}"
            )
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
        start = self.surface.inner(camera)
        rim = start.fx / max(start.t[2], 1e-9)
        window = self._window(start)
        wide, *steps = [
            Comparison(shape, image, max(round(rim / size), 1), window)
            for shape, size in zip(self.shapes, SIZES, strict=True)
        ]
        # From coarse to fine, with fewer and fewer of those that may be it
        found = _best(_spread(start, wide), steps[0])
        for step, kept in zip(steps, KEPT, strict=True):
            radius = REACH * rim / 4 if step is steps[0] else 4.0 * step.times
            climbed = [self._climb(step, each, radius, free_focal) for each in found[:kept]]
            found = _best(climbed, step)
        near = max(AGREE * rim, NEAREST)
        places = _apart(found, self.surface.visible_points(found[0]), near)
        grey = to_grey(image)
        settled = [settle(grey, each, self.surface, self.edges, free_focal) for each in places]
        settled.sort(key=lambda pair: -pair[1])
        best, share = settled[0]
        score = steps[-1].information(steps[-1].faces(best))
        others = [each for each in settled if _miss(each[0], best, self.surface) > near]
        second = max((share for _, share in others), default=0.0)
        converged = score > AHEAD and share > max(AGREED, second + APART_BY)
        return Refined(self.surface.outer(best), score, converged)

    def _climb(self, step: Comparison, camera: Camera, radius: float, free_focal: bool) -> Camera:
        """The camera of most information nearby (COBYQA: Ragonneau 2022, which needs no slopes)."""
        points = self.surface.visible_points(camera)
        if len(points) < 6:
            return camera
        motions = _Motions(camera, points, free_focal)
        result = minimize(
            lambda numbers: -step.information(step.faces(motions(numbers))),
            np.zeros(6 + free_focal),
            method="COBYQA",
            options={
                "initial_tr_radius": radius, "final_tr_radius": 0.1 * step.times, "maxfev": 200,
            },
        )  # fmt: skip
        return motions(result.x)

    def _window(self, camera: Camera) -> tuple[int, int, int, int]:
        """Where the object can be: around where it should be by as much as the start may be off."""
        left, top, right, bottom = self.surface.window(camera)
        more = int(REACH * camera.fx)
        return (
            max(left - more, 0), max(top - more, 0),
            min(right + more, camera.width), min(bottom + more, camera.height),
        )  # fmt: skip


def _miss(a: Camera, b: Camera, surface: Surface) -> float:
    """Pixels, RMS, between where two cameras see the object."""
    points = surface.visible_points(b)
    return float(np.sqrt(((a.project(points) - b.project(points))[:, :2] ** 2).sum(1).mean()))


def _apart(cameras: list[Camera], points: np.ndarray, near: float) -> list[Camera]:
    """Those that see points (n, 3) at other places than all before them, pixels RMS."""
    kept: list[np.ndarray] = []
    found = []
    for camera in cameras:
        at = camera.project(points)[:, :2]
        if all(np.sqrt(((at - other) ** 2).sum(1).mean()) > near for other in kept):
            kept.append(at)
            found.append(camera)
    return found


def _spread(camera: Camera, step: Comparison) -> list[Camera]:
    """Cameras within reach of one: turned about the object, nearer or farther, and moved to where
    the object fits the frame best."""
    rng = np.random.default_rng(1)
    found = []
    for nth in range(TURNS):
        turn = rng.normal(size=3)
        turn *= REACH * rng.uniform() ** (1 / 3) / np.linalg.norm(turn)
        farther = 1 + REACH * rng.uniform(-0.7, 0.7)
        if nth:
            R = Rotation.from_rotvec(turn).as_matrix() @ camera.R
            turned = replace(camera, R=R, t=camera.t * [1, 1, farther])
        else:
            turned = camera
        found.append(turned)
        found += _shifted(step, turned)
    return found


def _shifted(step: Comparison, camera: Camera) -> list[Camera]:
    """The camera moved so that the object lies where, in the plane, it fits best; the best few."""
    reach = int(np.ceil(REACH * camera.fx / step.times))
    face = step.faces(camera, reach)
    span = np.arange(-reach, reach + 1, APART)
    told = np.array([[step.shifted(face, int(c), int(r)) for c in span] for r in span])
    peak = told == cv2.dilate(told, np.ones((3, 3)))
    row, col = np.nonzero(peak)
    best = np.argsort(-told[row, col])[:PLACES]
    moves = np.column_stack([span[col[best]] / camera.fx, span[row[best]] / camera.fy])
    moves *= step.times * camera.t[2]
    return [replace(camera, t=camera.t + np.append(move, 0)) for move in moves]


def _best(cameras: list[Camera], step: Comparison) -> list[Camera]:
    return sorted(cameras, key=lambda c: -step.information(step.faces(c)))
