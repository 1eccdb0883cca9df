"""From frames, a mesh and one known camera to the cameras of all frames ([PCD*10], §3).

register_frames   every frame's camera, from those that are known
Options           what a user may choose
Registration      the cameras, and per frame how well each is known
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..geometry.camera import Camera
from ..progress import Progress
from .bundle import adjust
from .results import FrameSource, Options, Registration
from .sequence import register_in_order
from .stills import register_by_likeness
from .tracker import Tracker

ADJUSTMENTS = 2  # after the first, outlines are looked for where the cameras have come to be


def register_frames(
    vertices: np.ndarray,
    faces: np.ndarray,
    frames: FrameSource,
    start: Mapping[int, Camera],
    options: Options | None = None,
    progress: Progress | None = None,
) -> Registration:
    """Every frame's camera, from those that are known.

    Parameters
    ----------
    vertices : (V, 3) float64, world coordinates
    faces : (F, 3) int32
    frames : undistorted, by index
    start : index of a frame → its camera; at least one. All frames have its focal length and centre

    Raises
    ------
    ValueError : `start` is empty, or a camera's size is not its frame's.
    """
    options, progress = options or Options(), progress or Progress()
    tracker = Tracker(vertices, faces, frames, start, options)
    if options.ordered:
        register_in_order(tracker, progress.part(0, 0.8))
    else:
        register_by_likeness(tracker, progress.part(0, 0.8))
    return finish(tracker, tracker.start, options.start_error, progress.part(0.8, 1.0))


def finish(
    tracker: Tracker, held: Mapping[int, Camera], error: float, progress: Progress
) -> Registration:
    """All cameras adjusted together, where the options say so, and every frame's result.

    held : cameras that are known but for an error of so many pixels, in the tracker's world
    """
    if tracker.options.adjust:
        for turn in range(ADJUSTMENTS):
            progress(turn / ADJUSTMENTS, "adjusting all cameras")
            tracker.take(
                adjust(
                    tracker.cameras, tracker.keyframes, tracker.matches, tracker.surface, held,
                    error / tracker.times, tracker.options.free_focal, tracker.outlines(),
                    settled=turn > 0,
                )
            )  # fmt: skip
            if turn == 0:
                tracker.retry()
    progress(1.0, "registered")
    return tracker.result()
