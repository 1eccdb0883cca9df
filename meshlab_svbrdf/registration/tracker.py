"""What is known while frames are registered: cameras, keyframes, and what each frame rests upon.

Everything here is in the surface's scaled world, at the size that frames are tracked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from ..geometry.camera import Camera
from .bundle import Adjusted
from .contrast import blur_effect, to_grey
from .keyframes import Keyframe, make_keyframe
from .locate import Located, locate
from .match import Matches
from .outlines import Outline, outline
from .overlay import feature_edges
from .pose import moved, twist_between
from .results import FrameResult, FrameSource, Options, Registration
from .surface import Surface
from .wide import NOTHING, Signature, describe

SURE = 0.5  # confidence from which on a frame may be a keyframe, and is not tried again


class Tracker:
    """Registers single frames, on demand; see `register_frames` for the parameters."""

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        frames: FrameSource,
        start: Mapping[int, Camera],
        options: Options,
    ) -> None:
        if not start:
            raise ValueError("start: expected at least one camera, index of its frame → camera")
        self.surface = Surface(vertices, faces)
        self.edges = feature_edges(self.surface.vertices, self.surface.faces)
        self.frames, self.options = frames, options
        self.whole = start[min(start)]
        self.times = int(np.ceil(np.sqrt(self.whole.width * self.whole.height / options.pixels)))
        self.start = {index: self.inner(camera) for index, camera in start.items()}
        self.cameras: dict[int, Camera] = {}
        self.located: dict[int, Located] = {}
        self.blur: dict[int, float] = {}
        self.reason: dict[int, str] = {}
        self.keyframes: list[Keyframe] = []
        self._signatures: dict[int, Signature] = {}
        for index in sorted(start):
            self._begin(index)

    @property
    def matches(self) -> dict[int, list[Matches]]:
        return {index: located.matches for index, located in self.located.items()}

    def read(self, index: int) -> np.ndarray | None:
        """A frame in grey, at the size of tracking; None where its size is another's."""
        image = to_grey(self.frames[index])
        if image.shape != (self.whole.height, self.whole.width):
            size = f"{image.shape[1]}×{image.shape[0]}"
            self.reason[index] = (
                f"its size is {size}, not the {self.whole.width}×{self.whole.height} of the start"
            )
            return None
        if self.times == 1:
            return image
        h, w = (n // self.times for n in image.shape)
        whole = image[: h * self.times, : w * self.times]
        return cv2.resize(whole, (w, h), interpolation=cv2.INTER_AREA)

    def signature(self, index: int) -> Signature:
        """A frame's own features; they are kept."""
        if index not in self._signatures:
            image = self.read(index)
            self._signatures[index] = NOTHING if image is None else describe(image)
        return self._signatures[index]

    def locate(self, index: int, image: np.ndarray, guess: Camera) -> Camera | None:
        """Register a frame from a guess; None, and a reason noted, where that fails."""
        located = locate(image, guess, self.keyframes, self.surface)
        if isinstance(located, str):
            self.reason[index] = located
            return None
        self._note(index, image, located)
        return located.camera

    def retry(self) -> int:
        """Register anew the frames that are not known, or hardly, from their neighbours' cameras as
        they were adjusted; how many are known better."""
        self.keyframes = [
            k.with_camera(self.cameras[k.index], self.surface) for k in self.keyframes
        ]
        better = 0
        for index in range(len(self.frames)):
            before = self.located.get(index)
            if index in self.start or (before is not None and before.confidence > SURE):
                continue
            guess = self.between(index) or self.cameras.get(index)
            image = self.read(index) if guess is not None else None
            if guess is None or image is None:
                continue
            found = locate(image, guess, self.keyframes, self.surface)
            if isinstance(found, str) or (before and found.confidence <= before.confidence):
                continue
            self._note(index, image, found)
            better += 1
        return better

    def outlines(self) -> dict[int, Outline]:
        """The geometry's lines in the keyframes, by frame."""
        found = {}
        for keyframe in self.keyframes:
            camera = self.cameras[keyframe.index]
            view = self.surface.view(camera, jumps=False)
            if view is not None:
                found[keyframe.index] = outline(
                    keyframe.image, view, camera, self.surface, self.edges
                )
        return found

    def result(self) -> Registration:
        """All frames' results, in the world, at the frames' own size."""
        frames = [self._frame(index) for index in range(len(self.frames))]
        return Registration(frames, [k.index for k in self.keyframes])

    def take(self, adjusted: Adjusted) -> None:
        """What the adjustment has found takes the place of what was."""
        self.cameras, self.keyframes = adjusted.cameras, adjusted.keyframes
        for index, located in self.located.items():
            if not located.total:
                self.located[index] = replace(located, camera=self.cameras[index])
            else:
                self.located[index] = replace(
                    located, camera=self.cameras[index], inliers=adjusted.inliers[index],
                    residual=adjusted.residual[index], uncertainty=adjusted.uncertainty[index],
                )  # fmt: skip

    def _begin(self, index: int) -> None:
        image = self.read(index)
        if image is None:
            raise ValueError(f"start: frame {index}: {self.reason[index]}")
        camera = self.start[index]
        self._note(index, image, Located(camera, [], 0, 0, 0.0, 0.0, 0.0))
        if all(k.index != index for k in self.keyframes):
            raise ValueError(f"start: frame {index}'s camera sees nothing of the object")

    def _note(self, index: int, image: np.ndarray, located: Located) -> None:
        self.located[index], self.cameras[index] = located, located.camera
        self.reason.pop(index, None)
        left, top, right, bottom = self.surface.window(located.camera)
        self.blur[index] = blur_effect(image[top:bottom, left:right])
        alike = np.exp(-((self.options.keyframe_angle / 20) ** 2))
        sure = located.confidence > SURE or not located.total
        if located.affinity < alike and sure:
            keyframe = make_keyframe(
                index, image, located.camera, self.surface, self.options.features
            )
            if keyframe is not None:
                self.keyframes.append(keyframe)

    def inner(self, camera: Camera) -> Camera:
        """A camera of whole frames in the world, as it is used here."""
        inner = self.surface.inner(camera.reduced(self.times))
        return replace(
            inner, width=camera.width // self.times, height=camera.height // self.times
        )  # fmt: skip

    def _outer(self, camera: Camera) -> Camera:
        """The inverse of `inner`."""
        return replace(
            self.whole, fx=camera.fx * self.times, fy=camera.fy * self.times, R=camera.R,
            t=self.surface.outer(camera).t,
        )  # fmt: skip

    def _frame(self, index: int) -> FrameResult:
        located = self.located.get(index)
        blur = self.blur.get(index, float("nan"))
        if located is not None and not located.total:
            return FrameResult(
                self._outer(located.camera), "registered", "", 0.0, 0, 1.0, blur
            )  # fmt: skip
        if located is not None and located.confidence >= self.options.cut:
            return FrameResult(
                self._outer(located.camera), "registered", "", self.times * located.residual,
                located.inliers, located.confidence, blur,
            )  # fmt: skip
        reason = self.reason.get(index, "it was not reached")
        if located is not None:
            reason = f"confidence {located.confidence:.2f}, {self.options.cut:g} is needed"
        bridged = None if index in self.cameras else self.between(index)
        if bridged is None:
            return FrameResult(None, "unregistered", reason, blur=blur)
        return FrameResult(self._outer(bridged), "bridged", reason, blur=blur)

    def between(self, index: int) -> Camera | None:
        """The camera between the nearest frames that are registered on both sides."""
        known = np.array(sorted(self.cameras.keys() - {index}))
        at = np.searchsorted(known, index)
        if not self.options.ordered or at == 0 or at == len(known):
            return None
        before, after = int(known[at - 1]), int(known[at])
        if after - before - 1 > self.options.bridge:
            return None
        a, b = self.cameras[before], self.cameras[after]
        return moved(a, twist_between(a, b) * (index - before) / (after - before))
