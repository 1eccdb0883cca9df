"""Cameras that are nearly right, made right against the geometry.

refine_camera    one camera, by mutual information with a rendering of the geometry
refine_cameras   all cameras of a sequence, from elsewhere
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..geometry.camera import Camera
from ..progress import Progress
from .track import FrameSource, Options, Registration


class Refined(NamedTuple):
    """camera, score (nats of mutual information), converged: whether it can be relied on."""

    camera: Camera
    score: float
    converged: bool


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
    raise NotImplementedError


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
