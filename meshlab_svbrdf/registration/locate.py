"""One frame's camera, from keyframes and a guess."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.camera import Camera
from .keyframes import Keyframe
from .match import Matches, match, target
from .pose import Fit, fit_camera
from .surface import Surface

KEYFRAMES = 3  # that a frame is compared with
ROUNDS = 4  # at most: each carries the keyframes over to the camera that the last one found
SETTLED = 4.0  # pixels of motion between rounds that change no match
FEWEST = 12  # inliers
GROSS = 30.0  # standard deviations
SHARE = 0.25  # of the matches that must agree
UNSURE = 4.0  # pixels of error that a registered frame may be expected to have
FAINT = 0.02  # affinity below which a keyframe is no help


@dataclass(frozen=True)
class Located:
    """A frame's camera in the scaled world, and what it rests upon.

    matches : per keyframe, those that are not grossly wrong: which of them are right only the
        adjustment of all cameras can tell
    inliers : matches that agree with the camera; total : matches there were
    residual : pixels, RMS of the inliers; uncertainty : pixels, RMS expected of the object
    affinity : of the most similar keyframe
    """

    camera: Camera
    matches: list[Matches]
    inliers: int
    total: int
    residual: float
    uncertainty: float
    affinity: float

    @property
    def confidence(self) -> float:
        """0..1: falls with the error to be expected, and where half the matches disagree or more.

        One pixel of expected error leaves a half; a quarter of agreement leaves nothing.
        """
        agreement = min(max((self.inliers / max(self.total, 1) - SHARE) / (0.5 - SHARE), 0.0), 1.0)
        return agreement / (1 + self.uncertainty**2)


def nearest(
    keyframes: Sequence[Keyframe], camera: Camera, count: int = KEYFRAMES
) -> list[tuple[float, int]]:
    """The keyframes most similar to what a camera sees: affinity and position, best first."""
    ranked = sorted(((k.affinity(camera), -at) for at, k in enumerate(keyframes)), reverse=True)
    return [(affinity, -at) for affinity, at in ranked[:count] if affinity > FAINT]


def locate(
    image: np.ndarray, guess: Camera, keyframes: Sequence[Keyframe], surface: Surface
) -> Located | str:
    """The camera of a frame, or in words why there is none.

    image : (h, w) uint8; guess : in the scaled world, wrong by some tens of pixels at most
    """
    for _ in range(ROUNDS):
        view = surface.view(guess)
        if view is None:
            return "the object is out of sight"
        chosen = nearest(keyframes, guess)
        if not chosen:
            return "no keyframe sees this side of the object"
        frame = target(image, view)
        found = [match(keyframes[at], at, frame) for _, at in chosen]
        fit = _fit(found, keyframes, guess)
        total = sum(map(len, found))
        if fit is None or total < FEWEST:
            return f"{total} features found again, {FEWEST} are needed"
        points = np.concatenate([keyframes[m.keyframe].points for m in found])
        moved = fit.camera.project(points)[:, :2] - guess.project(points)[:, :2]
        guess = fit.camera
        if np.sqrt((moved**2).sum(1).mean()) < SETTLED:
            return _accepted(fit, found, points, chosen[0][0])
    return "the camera does not settle"


def _accepted(fit: Fit, found: list[Matches], points: np.ndarray, affinity: float) -> Located | str:
    """The frame, or what speaks against it; points (n, 3) : of the object."""
    inliers, total = int(fit.inlier.sum()), len(fit.inlier)
    if inliers < FEWEST:
        return f"{inliers} of {total} features agree, {FEWEST} are needed"
    if inliers < SHARE * total:
        return f"{inliers} of {total} features agree, {SHARE:.0%} are needed"
    uncertainty = fit.uncertainty(points)
    if not uncertainty < UNSURE:
        return f"the camera is known to {uncertainty:.1f} pixels only"
    near, starts = fit.deviation < GROSS, np.cumsum([0, *map(len, found)])
    kept = [m[near[a:b]] for m, a, b in zip(found, starts[:-1], starts[1:], strict=True)]
    residual = float(np.sqrt((fit.residual[fit.inlier] ** 2).sum(1).mean()))
    return Located(fit.camera, kept, inliers, total, residual, uncertainty, affinity)


def _fit(found: list[Matches], keyframes: Sequence[Keyframe], guess: Camera) -> Fit | None:
    points = np.concatenate([keyframes[m.keyframe].points[m.feature] for m in found])
    pixels = np.concatenate([m.found for m in found])
    whitener = np.concatenate([m.whitener for m in found])
    return fit_camera(points, pixels, whitener, guess)
