"""Frames without an order: each is found from those that are registered, until no more are."""

from __future__ import annotations

import numpy as np

from ..progress import Progress
from .tracker import Tracker
from .wide import camera_from_pairs, on_surface, pair

TOGETHER = 8  # keyframes whose pairs vote together
NEAR = 12  # pairs of one keyframe that are worth a try


def register_by_likeness(tracker: Tracker, progress: Progress) -> None:
    """Register, again and again, the frame that has most in common with the registered ones."""
    count = len(tracker.frames)
    pairs: dict[int, dict[int, tuple[np.ndarray, np.ndarray]]] = {k: {} for k in range(count)}
    compared = 0
    tried: dict[int, int] = {}
    while True:
        left = [k for k in range(count) if k not in tracker.cameras]
        progress(1 - len(left) / count, "photographs")
        # Compare every frame that is left with the keyframes that are new
        for at in range(compared, len(tracker.keyframes)):
            keyframe = tracker.keyframes[at]
            places = on_surface(tracker.signature(keyframe.index), keyframe)
            for index in left:
                found = pair(tracker.signature(index), *places)
                if len(found[0]) >= NEAR:
                    pairs[index][at] = found
        compared = len(tracker.keyframes)
        # Take the one with most pairs that has something new since it was last tried
        score = {
            k: sum(sorted((len(p[0]) for p in pairs[k].values()), reverse=True)[:TOGETHER])
            for k in left
        }
        open_ = [k for k in left if score[k] > tried.get(k, 0)]
        if not open_:
            break
        index = max(open_, key=lambda k: score[k])
        tried[index] = score[index]
        _try(tracker, index, pairs[index])
    for index in range(count):
        if index not in tracker.cameras and not pairs[index]:
            tracker.reason.setdefault(index, "it has too little in common with any other frame")


def _try(tracker: Tracker, index: int, pairs) -> None:
    best = sorted(pairs.values(), key=lambda p: -len(p[0]))[:TOGETHER]
    pixels, points = (np.concatenate(p) for p in zip(*best, strict=True))
    found = camera_from_pairs(pixels, points, tracker.start[min(tracker.start)])
    if found is None:
        tracker.reason[index] = f"no camera agrees with its {len(pixels)} pairs of features"
        return
    image = tracker.read(index)
    if image is not None:
        tracker.locate(index, image, found[0])
