"""Normals corrected where the highlights say so: poor normals are the largest error of all.

A texel's normal has two free angles. They are fitted to what the lobes leave unexplained of its
samples, its diffuse term eliminated, with a Gaussian prior: a texel that shows no highlight keeps
its normal. How large the corrections may be is chosen by the other half of the film, which the
corrections have not seen. (Every other frame would not do: neighbouring frames share their errors.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..blocks import places, room, rowwise
from ..samples.observations import Observations
from .lights import Light
from .normal_steps import ALL, FIRST, refine
from .phong import cast_shadows, lamps

SIGMAS = np.radians([0.25, 0.5, 1.0, 2.0, 4.0])
"""Priors tried: standard deviation of a normal's error per angle, radians."""
WORTHWHILE = 0.05
"""Share of the residual's variance on unseen samples that corrections must take away."""
LEAST = 16
"""Samples of a texel, below which its normal is kept."""


@dataclass(frozen=True)
class NormalRefinement:
    """What came of it.

    normal : (T, 3) float32, unit; sigma : the prior chosen, radians, 0 where normals are kept
    gain : share of the residual's variance that it takes from unseen samples
    turned : median angle of the corrections of the texels that show a highlight, radians
    """

    normal: np.ndarray
    sigma: float
    gain: float
    turned: float


def refine_normals(
    observations: Observations,
    material: np.ndarray,
    rho_s: np.ndarray,
    alpha: np.ndarray,
    noise: np.ndarray,
    lights: list[Light],
    *,
    trial_texels: int = 4_000,
    progress=lambda done, total: None,
) -> NormalRefinement:
    """Correct the texels' normals, if that predicts samples that the corrections have not seen.

    Parameters
    ----------
    material : (T,) int32, -1 for none
    rho_s, alpha, noise : (M,) of the materials, 0..100, NaN where unobserved; noise is the robust
        standard deviation of the residuals
    trial_texels : about how many texels the prior is chosen on: half of their samples correct, the
        other half judge
    """
    view = observations.view
    rho = np.nan_to_num(np.asarray(rho_s, np.float64))
    shininess = np.nan_to_num(np.asarray(alpha, np.float64), nan=1.0)
    shape = (
        observations.shape if observations.shape is not None else np.zeros((0, 3, 3), np.float32)
    )
    kept = NormalRefinement(view.normal, 0.0, 0.0, 0.0)
    shines = np.append(rho > 0, False)
    glossy = rowwise(
        lambda count, own: (count >= LEAST) & shines[own], observations.store.counts(), material
    )
    texels = places(glossy)

    def run(texels: np.ndarray, sigma: float, half: int, tell) -> tuple[np.ndarray, np.ndarray]:
        normals = room(view.normal.shape, np.float32)
        normals[:] = view.normal
        bulbs = lamps(
            lights, observations.texels.radius, cast_shadows(observations, texels, lights)
        )

        def work(block, own):
            sums = np.zeros(3)
            refine(
                block, texels[own], view, observations.pixel, shape, material, rho, shininess,
                np.asarray(noise, np.float64), bulbs, sigma, half, normals, sums,
            )  # fmt: skip
            return sums

        parts = observations.store.map_texels(work, texels, tell)
        return normals, sum(parts, np.zeros(3))

    # Raise the prior as long as the other half of the film is predicted better
    trial, best, gain = texels[:: max(1, len(material) // trial_texels)], 0.0, 0.0
    for sigma in SIGMAS if len(trial) else ():
        before, after, _ = run(trial, sigma, FIRST, lambda d, t: None)[1]
        took = 1 - after / before if before > 0 else 0.0
        if took <= gain:
            break
        best, gain = float(sigma), float(took)
    if gain < WORTHWHILE:
        return replace(kept, gain=gain)
    normals, _ = run(texels, best, ALL, progress)
    chord = rowwise(lambda new, old: np.linalg.norm(new - old, axis=1), normals, view.normal)
    turned = float(np.median(chord[chord > 0])) if (chord > 0).any() else 0.0
    return NormalRefinement(normals, best, gain, turned)
