"""Frames without an order: each is found from those that are registered, until no more are."""

from __future__ import annotations

import numpy as np

from ..progress import Progress
from .tracker import Tracker
from .wide import camera_from_pairs, likeness, on_surface, pair

TOGETHER = 6  # keyframes whose pairs vote together


def register_by_likeness(tracker: Tracker, progress: Progress) -> None:
    """Register, again and again, the frame that has most in common with the registered ones."""
    count = len(tracker.frames)
    places: list[tuple[np.ndarray, np.ndarray]] = []
    votes = np.zeros((count, 0), int)
    tried: dict[int, list[int]] = {}
    while True:
        left = [k for k in range(count) if k not in tracker.cameras]
        progress(1 - len(left) / count, f"{count - len(left)} frames registered")
        # Compare every frame that is left with the keyframes that are new
        for keyframe in tracker.keyframes[len(places) :]:
            places.append(on_surface(tracker.signature(keyframe.index), keyframe))
            column = np.zeros((count, 1), int)
            for k in left:
                column[k] = likeness(tracker.signature(k).descriptors, places[-1][1])
            votes = np.hstack([votes, column])
        # Take the one with most votes that has something new since it was last tried
        best = {k: sorted(np.argsort(-votes[k], kind="stable")[:TOGETHER]) for k in left}
        open_ = [k for k in left if tried.get(k) != best[k]]
        if not open_:
            break
        index = max(open_, key=lambda k: np.sort(votes[k])[-TOGETHER:].sum())
        tried[index] = best[index]
        _try(tracker, index, [places[at] for at in best[index]])


def _try(tracker: Tracker, index: int, places: list[tuple[np.ndarray, np.ndarray]]) -> None:
    pairs = [pair(tracker.signature(index), *place) for place in places]
    pixels, points = (np.concatenate(p) for p in zip(*pairs, strict=True))
    found = camera_from_pairs(pixels, points, tracker.start[min(tracker.start)])
    if found is None:
        tracker.reason[index] = f"no camera agrees with its {len(pixels)} pairs of features"
        return
    image = tracker.read(index)
    if image is not None:
        tracker.locate(index, image, found[0])
