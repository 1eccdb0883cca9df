"""Cameras that are nearly right, made right against the geometry.

refine_camera    one camera, by mutual information with a rendering of the geometry
refine_cameras   all cameras of a sequence, from elsewhere
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ..geometry.camera import Camera
from ..progress import Progress
from .mutual_information import Comparison, face_predictors
from .results import FrameSource, Options, Registration
from .surface import Surface

SIZES = (60, 120, 240)  # pixels that the object's radius has at each step, from coarse to fine
REACH = 0.09  # radians, or share of the distance, by which a start may be off
AGREE = 0.015  # of the object's radius in the frame, within which two searches must end


class Refined(NamedTuple):
    """camera, score (nats of mutual information), converged: whether it can be relied on."""

    camera: Camera
    score: float
    converged: bool


@dataclass(frozen=True)
class _Motions:
    """Cameras around one, by numbers that each move the object's rim by as many pixels as they say.

    Three turns about the object's centre, three shifts; with `free_focal`, the focal length at the
    same size of the object.
    """

    camera: Camera
    rim: float  # the object's radius, pixels
    free_focal: bool

    def __len__(self) -> int:
        return 6 + self.free_focal

    def __call__(self, numbers: np.ndarray) -> Camera:
        c, share = self.camera, np.asarray(numbers) / self.rim
        R = Rotation.from_rotvec(share[:3]).as_matrix() @ c.R
        depth = c.t[2]
        lever = min(self.rim / c.fx, 0.9)
        t = c.t + depth * np.array([share[3] * lever, share[4] * lever, share[5]])
        if self.free_focal:
            longer = np.exp(share[6] / lever)
            return replace(c, R=R, t=t * [1, 1, longer], fx=c.fx * longer, fy=c.fy * longer)
        return replace(c, R=R, t=t)


class InformationSearch:
    """`refine_camera` for many frames of one surface; cameras in the world."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.predictors = face_predictors(surface)

    def refine(self, image: np.ndarray, camera: Camera, free_focal: bool = False) -> Refined:
        """See `refine_camera`."""
        if image.shape[:2] != (camera.height, camera.width):
            raise ValueError(
                f"image: expected {camera.width}×{camera.height} as the camera says, "
                f"not {image.shape[1]}×{image.shape[0]}"
            )
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image
        start = camera.about(self.surface.center)
        rim = start.fx * self.surface.radius / max(start.t[2], 1e-9)
        window = self._window(start)
        steps = [
            Comparison(self.surface, self.predictors, image, times, window)
            for times in sorted({max(round(rim / size), 1) for size in SIZES}, reverse=True)
        ]
        found = _shifted(steps[0], start)
        radius = REACH * rim / 2
        for step in steps:
            found = _climb(step, found, rim, radius, free_focal)
            radius = 3.0 * step.times
        # Whoever comes from elsewhere must get to the same place
        best, score = found, steps[-1].information(steps[-1].faces(found))
        errors = []
        points = self.surface.visible_vertices(best)
        for sign in (1, -1):
            away = sign * 0.25 * REACH * rim * np.array([1, -1, 1, 0.3, -0.3, 0.5, 0])
            motions = _Motions(best, rim, free_focal)
            other = motions(away[: len(motions)])
            radius = REACH * rim / 4
            for step in steps[:-1]:
                other = _climb(step, other, rim, radius, free_focal)
                radius = 3.0 * step.times
            moved = other.project(points)[:, :2] - best.project(points)[:, :2]
            errors.append(float(np.sqrt((moved**2).sum(1).mean())))
        self.errors = errors
        converged = max(errors) < AGREE * rim
        return Refined(best.about(-self.surface.center), score, converged)

    def _window(self, camera: Camera) -> tuple[int, int, int, int]:
        """Where the object can be: around where it should be by as much as the start may be off."""
        left, top, right, bottom = self.surface.window(camera)
        more = int(REACH * camera.fx)
        return (
            max(left - more, 0), max(top - more, 0),
            min(right + more, camera.width), min(bottom + more, camera.height),
        )  # fmt: skip


def _shifted(step: Comparison, camera: Camera) -> Camera:
    """The camera turned so that the object lies where, in the plane, it fits best."""
    face = step.faces(camera)
    reach = int(np.ceil(REACH * camera.fx / step.times))
    shifts = [(c, r) for c in range(-reach, reach + 1) for r in range(-reach, reach + 1)]
    best = max(shifts, key=lambda s: step.shifted(face, *s))
    move = np.array([best[0] / camera.fx, best[1] / camera.fy]) * step.times * camera.t[2]
    return replace(camera, t=camera.t + [*move, 0])


def _climb(
    step: Comparison, camera: Camera, rim: float, radius: float, free_focal: bool
) -> Camera:
    """The camera of most information nearby (COBYQA: Ragonneau and Zhang 2023, without slopes)."""
    motions = _Motions(camera, rim, free_focal)
    result = minimize(
        lambda numbers: -step.information(step.faces(motions(numbers))),
        np.zeros(len(motions)),
        method="COBYQA",
        options={
            "initial_tr_radius": radius, "final_tr_radius": 0.1 * step.times, "maxfev": 300,
        },
    )  # fmt: skip
    return motions(result.x)


def refine_camera(
    vertices: np.ndarray,
    faces: np.ndarray,
    image: np.ndarray,
    camera: Camera,
    free_focal: bool = False,
) -> Refined:
    """One camera by mutual information of the frame and the geometry (Corsini et al. 2009).

    Parameters
    ----------
    vertices : (V, 3) float64; faces : (F, 3) int32
    image : (h, w) or (h, w, 3) uint8, of the camera's size
    camera : off by no more than about 5° and 5 % of the distance
    free_focal : find the focal length too
    """
    surface = Surface(vertices, faces)
    return InformationSearch(surface).refine(image, camera, free_focal)


def refine_cameras(
    vertices: np.ndarray,
    faces: np.ndarray,
    frames: FrameSource,
    cameras: Mapping[int, Camera],
    options: Options | None = None,
    progress: Progress | None = None,
) -> Registration:
    """Cameras from elsewhere (structure from motion), refined together against the mesh.

    Frames without a camera in `cameras` are named unregistered; scale and pose as a whole are
    expected to be roughly those of the mesh.
    """
    raise NotImplementedError
