"""Frames in order: each starts from where the last ones were going."""

from __future__ import annotations

import numpy as np

from ..geometry.camera import Camera
from ..progress import Progress
from .locate import nearest
from .pose import predicted
from .tracker import Tracker
from .wide import camera_from_pairs, describe, on_surface, pair

SIGNATURES = 4  # keyframes that a lost frame is compared with


def register_in_order(tracker: Tracker, progress: Progress) -> None:
    """Register the frames after the first known one, then those before it, then what was lost."""
    count, first = len(tracker.frames), min(tracker.start)
    for done, index in enumerate([*range(first + 1, count), *range(first - 1, -1, -1)], 1):
        step = 1 if index > first else -1
        if index not in tracker.cameras:
            _follow(tracker, index, step)
        progress(done / count, f"frame {index}")
    # What was lost may be found from what came later
    lost = [index for index in range(count) if index not in tracker.cameras]
    for index in lost:
        near = [index + d for d in (-1, 1) if index + d in tracker.cameras]
        image = tracker.read(index) if near else None
        for neighbour in near:
            if image is None or index in tracker.cameras:
                break
            tracker.locate(index, image, tracker.cameras[neighbour])


def _follow(tracker: Tracker, index: int, step: int) -> None:
    image = tracker.read(index)
    if image is None:
        return
    known = tracker.cameras
    last = next(
        k for k in range(index - step, -1 if step > 0 else len(tracker.frames), -step) if k in known
    )
    steps = abs(index - last)
    guesses: list[Camera] = []
    if last - step in known and steps <= 3:
        guesses.append(predicted(known[last - step], known[last], steps))
    guesses.append(known[last])
    for guess in guesses:
        if tracker.locate(index, image, guess) is not None:
            return
    reason = tracker.reason[index]
    found = find_again(tracker, image, known[last])
    if found is None or tracker.locate(index, image, found) is None:
        tracker.reason[index] = reason


def find_again(tracker: Tracker, image: np.ndarray, near: Camera) -> Camera | None:
    """A frame's camera without a guess, from keyframes that saw about what `near` sees."""
    signature = describe(image)
    chosen = [tracker.keyframes[at] for _, at in nearest(tracker.keyframes, near, SIGNATURES)]
    pairs = [pair(signature, *on_surface(tracker.signature(k.index), k)) for k in chosen]
    if not pairs:
        return None
    pixels, points = (np.concatenate(p) for p in zip(*pairs, strict=True))
    found = camera_from_pairs(pixels, points, near)
    return found[0] if found else None
