"""Cameras that are nearly right, made right against the geometry.

refine_camera    one camera, by mutual information with a rendering of the geometry
settle_camera    one camera that is off by some pixels only, by the geometry's lines
refine_cameras   all cameras of a sequence, from elsewhere
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..geometry.camera import Camera
from ..progress import Progress
from .contrast import to_grey
from .overlay import feature_edges
from .results import FrameSource, Options, Registration
from .search import AGREED, InformationSearch, Refined, settle
from .surface import Surface
from .track import finish
from .tracker import Tracker

GIVEN_ERROR = 2.0  # pixels by which each of the cameras from elsewhere is expected to be wrong

__all__ = ["Refined", "refine_camera", "refine_cameras", "settle_camera"]


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


def settle_camera(
    vertices: np.ndarray,
    faces: np.ndarray,
    image: np.ndarray,
    camera: Camera,
    free_focal: bool = False,
) -> Refined:
    """One camera by the geometry's own lines; its score is the share of them that the frame has.

    camera : off by some pixels, as from picked points; for the others see `refine_camera`
    """
    surface = Surface(vertices, faces)
    edges = feature_edges(surface.vertices, surface.faces)
    found, share = settle(to_grey(image), surface.inner(camera), surface, edges, free_focal)
    return Refined(surface.outer(found), share, share > AGREED)


def refine_cameras(
    vertices: np.ndarray,
    faces: np.ndarray,
    frames: FrameSource,
    cameras: Mapping[int, Camera],
    options: Options | None = None,
    progress: Progress | None = None,
) -> Registration:
    """Cameras from elsewhere (structure from motion), refined together against the mesh.

    Every frame is matched, from its own camera, with frames that see the same side of the object,
    and all are adjusted. Frames without a camera in `cameras`, or whose camera is wrong by more
    than some tens of pixels, are named unregistered.

    Scale and pose as a whole are expected to be roughly those of the mesh. See `register_frames`.
    """
    options, progress = options or Options(), progress or Progress()
    if not cameras:
        raise ValueError("cameras: expected at least one, index of its frame → camera")
    first = min(cameras)
    tracker = Tracker(vertices, faces, frames, {first: cameras[first]}, options)
    # The most similar first: each is matched with keyframes that stand already
    left = {k: tracker.inner(camera) for k, camera in cameras.items() if k != first}
    total, compared = len(left), 0
    affinity = dict.fromkeys(left, 0.0)
    while left:
        for keyframe in tracker.keyframes[compared:]:
            for k, camera in left.items():
                affinity[k] = max(affinity[k], keyframe.affinity(camera))
        compared = len(tracker.keyframes)
        index = max(left, key=lambda k: affinity[k])
        guess, image = left.pop(index), tracker.read(index)
        if image is not None:
            tracker.locate(index, image, guess)
        progress(0.8 * (1 - len(left) / total), f"frame {index}")
    held = {k: tracker.inner(camera) for k, camera in cameras.items() if k in tracker.cameras}
    return finish(tracker, held, GIVEN_ERROR, progress.part(0.8, 1.0))
