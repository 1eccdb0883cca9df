"""What a user may choose of the registration, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..geometry.camera import Camera


class FrameSource(Protocol):
    """Frames by index: a list of arrays will do, and so will a reader of a video.

    Frames are read in order from the known ones on; those that could not be registered are read
    again at the end.
    """

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> np.ndarray:
        """Frame `index`, (h, w) or (h, w, 3) uint8, sRGB, undistorted."""
        ...


@dataclass(frozen=True)
class Options:
    """How frames are registered; the defaults are for anything from 320 to 4000 pixels wide.

    ordered : neighbouring frames show nearly the same (a video): each starts from the last one's
        camera. False (stills): every frame is matched with those that are registered already
    pixels : frames are tracked at a size that has at most about so many pixels
    features : points that are tracked from one keyframe
    keyframe_angle : degrees of view direction between keyframes
    start_error : pixels, RMS, by which the known cameras may be wrong; where they come from a few
        picked points, give what those leave
    adjust : adjust all cameras together at the end
    free_focal : the adjustment finds the focal length too, one for all frames
    bridge : a frame without a camera of its own gets one between its neighbours' (ordered),
        where the gap has at most so many frames
    cut : frames of less confidence are named unregistered
    """

    ordered: bool = True
    pixels: int = 1_000_000
    features: int = 300
    keyframe_angle: float = 10.0
    start_error: float = 0.05
    adjust: bool = True
    free_focal: bool = False
    bridge: int = 15
    cut: float = 0.1


@dataclass(frozen=True)
class FrameResult:
    """What is known of one frame.

    camera : of the frame's own size; None where it is unregistered
    status : "registered", "bridged" (between its neighbours', not measured) or "unregistered"
    reason : in words, why it is not registered; "" where it is
    residual : pixels, RMS distance of the inliers from where the surface predicts them; NaN: none
    inliers : features that agree with the camera
    confidence : 0..1, what the inliers' number, share, spread and residual say together
    blur : 0 (sharp) .. 1, of the object's part of the frame (Crete et al. 2007); NaN: not seen
    """

    camera: Camera | None
    status: str
    reason: str = ""
    residual: float = float("nan")
    inliers: int = 0
    confidence: float = 0.0
    blur: float = float("nan")


@dataclass(frozen=True)
class Registration:
    """Every frame's result, in the frames' order, and which of them were keyframes."""

    frames: list[FrameResult]
    keyframes: list[int]

    @property
    def cameras(self) -> dict[int, Camera]:
        """The cameras of registered and bridged frames."""
        return {k: f.camera for k, f in enumerate(self.frames) if f.camera is not None}
