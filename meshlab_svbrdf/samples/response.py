"""A camera's response, from exposures of one view (Debevec and Malik 1997, by OpenCV)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..errors import SvbrdfError
from .luminance import decode

DARK, BRIGHT = 12, 243
"""Codes between which a pixel tells of the response."""
PIXELS = 256  # that the response is solved from; the unknowns are as many
LEAST_RATIO = 1.4  # of the longest exposure to the shortest
LEAST_SHARED = 64  # pixels, in every channel, that two exposures show well
LEAST_SPAN = 120  # codes, from the darkest to the brightest of these
WORST = 0.08  # median |ln| by which two exposures may disagree
GREY = 128
"""The code whose light is taken to be sRGB's: a response has no scale of its own."""


class Response(NamedTuple):
    """light : (256, 3) float64, of each code and channel, as sRGB's at code 128
    disagreement : median |ln| of what two exposures tell of the same pixel
    """

    light: np.ndarray
    disagreement: float


def estimate_response(stacks: Sequence[np.ndarray], exposures: Sequence[float]) -> Response:
    """The light that a camera's codes stand for.

    Parameters
    ----------
    stacks : of some views, (K, N, 3) uint8: pixels as each of K exposures shows them
    exposures : (K,) relative

    Raises
    ------
    SvbrdfError : the exposures cannot tell: they are too alike, share too few pixels that are
        neither dark nor clipped, or contradict each other.
    """
    times = np.asarray(exposures, np.float64)
    cannot = "transfer=estimate: the camera's response cannot be told: "
    if times.max() < LEAST_RATIO * times.min():
        raise SvbrdfError(
            f"{cannot}the longest exposure is {times.max() / times.min():.2f} times the shortest, "
            f"{LEAST_RATIO} at least are needed; say what the transfer function is"
        )
    codes = np.concatenate(stacks, axis=1)
    well = (codes >= DARK) & (codes <= BRIGHT)
    shared = well.sum(0) >= 2
    seen = np.where(well & shared, codes, np.uint8(0)).reshape(-1, 3)
    span = [np.ptp(seen[seen[:, k] > 0, k], axis=0) if shared[:, k].any() else 0 for k in range(3)]
    if shared.sum(0).min() < LEAST_SHARED or min(span) < LEAST_SPAN:
        raise SvbrdfError(
            f"{cannot}{shared.sum(0).min()} pixels of the object are neither dark nor clipped in "
            f"two exposures, over {min(span)} codes; {LEAST_SHARED} over {LEAST_SPAN} are needed: "
            "take exposures that are nearer to each other, or say what the transfer function is"
        )
    chosen = _spread(codes, shared)
    side = int(np.sqrt(PIXELS))
    pictures = [np.ascontiguousarray(row[chosen].reshape(side, side, 3)) for row in codes]
    solver = cv2.createCalibrateDebevec(samples=PIXELS, lambda_=20.0, random=False)
    light = np.asarray(solver.process(pictures, times.astype(np.float32)), np.float64).reshape(
        -1, 3
    )
    light = np.maximum.accumulate(light, axis=0)
    light *= decode(np.array(GREY / 255)) / light[GREY]
    light[0] = 0
    told = Response(light, _disagreement(light, codes, well, times))
    if not told.disagreement < WORST:
        raise SvbrdfError(
            f"{cannot}its exposures disagree by {told.disagreement:.0%}: something moved, the "
            "camera changed more than its exposure, or the exposures told are wrong"
        )
    return told


def _spread(codes: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Which PIXELS of (K, N, 3) codes, spread evenly from dark to bright; some twice where there
    are not so many."""
    usable = np.flatnonzero(shared.any(-1))
    order = usable[np.argsort(codes.mean((0, 2))[usable], kind="stable")]
    return order[np.linspace(0, len(order) - 1, PIXELS).round().astype(int)]


def _disagreement(
    light: np.ndarray, codes: np.ndarray, well: np.ndarray, times: np.ndarray
) -> float:
    told = np.stack([np.log(np.maximum(light[codes[..., k], k], 1e-9)) for k in range(3)], -1)
    told -= np.log(times)[:, None, None]
    order = np.argsort(times)
    pairs = [np.abs(told[b] - told[a])[well[a] & well[b]] for a, b in itertools.pairwise(order)]
    return float(np.median(np.concatenate(pairs)))
