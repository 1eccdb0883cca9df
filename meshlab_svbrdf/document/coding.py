"""How frames' numbers stand for light: what is known of a project's frames beyond their files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..samples.transfer import AUTO, LINEAR, SRGB, clip_level, light_of
from .images import reduced


class Light(NamedTuple):
    """radiance : (H, W, 3) float32, linear light, 1 being the frames' own white
    clipped : from where on a pixel may have been brighter; infinite: none is
    """

    radiance: np.ndarray
    clipped: float


@dataclass(frozen=True)
class Coding:
    """transfer : of coded frames, one of samples.transfer.TRANSFERS; "auto": as the file tells,
        else sRGB. Floats are linear light in any case.
    clip : from where on pixels may have been brighter, a signal 0..1 of coded frames, light of
        floats; 0: the last codes, and no floats
    white : the light that results call 1; None: it is not known yet
    response : (256, 3), the light of every code, measured; None: the transfer function tells
    """

    transfer: str = AUTO
    clip: float = 0.0
    white: float | None = None
    response: np.ndarray | None = None

    @property
    def known(self) -> bool:
        """Whether frames are shown by it, not by their files alone."""
        return self.white is not None

    def light(
        self, values: np.ndarray, reduce: int = 1, told: str = SRGB, wide_gamut: bool = False
    ) -> Light:
        """Linear light of a frame's values (H, W, 3), by what its file `told`."""
        transfer = told if self.transfer == AUTO else self.transfer
        radiance = light_of(values, transfer, wide_gamut=wide_gamut, response=self.response)
        clipped = clip_level(
            values.dtype, transfer, clip=self.clip, mean=reduce > 1, response=self.response
        )
        return Light(reduced(radiance, reduce), clipped)

    def name(self, told: str) -> str:
        """The transfer function of a frame whose file tells `told`."""
        if told == LINEAR or self.transfer == AUTO:
            return told
        return self.transfer

    def to_json(self) -> dict[str, Any]:
        response = None if self.response is None else self.response.tolist()
        return {
            "transfer": self.transfer, "clip": self.clip, "white": self.white, "response": response,
        }  # fmt: skip

    @classmethod
    def told(cls, frames: dict[str, Any]) -> Coding | None:
        """What frames.json tells; None where all frames are 8-bit sRGB."""
        told = frames.get("coding")
        return None if told is None else cls.from_json(told)

    @classmethod
    def from_json(cls, told: dict[str, Any]) -> Coding:
        """What `to_json` wrote."""
        response = told["response"]
        return cls(
            told["transfer"], told["clip"], told["white"],
            None if response is None else np.array(response),
        )  # fmt: skip
