"""What D still holds once the lobes are off: the ambient light's highlight, the pixels' blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..blocks import blocks, room, rowwise
from ..samples.observations import Observations
from .ambient import ambient_light, highlight_share, openness
from .footprint import Footprints
from .lights import Light
from .sharpen import sharpen


@dataclass(frozen=True)
class Finished:
    """diffuse : (T, 3) float32, linear RGB 0..100
    ambient : (3,) radiance for lamps of mean gain 1; 0 where it is not seen
    highlight : (T, 3) float32, 0..100, what the ambient light adds by its highlight
    notes : what is to be said
    """

    diffuse: np.ndarray
    ambient: np.ndarray
    highlight: np.ndarray
    notes: list[str]


def finish_diffuse(
    observations: Observations,
    diffuse: np.ndarray,
    material: np.ndarray,
    rho_s: np.ndarray,
    alpha: np.ndarray,
    tint: np.ndarray,
    lights: list[Light],
    *,
    ambient: bool = True,
    covered: Footprints | None = None,
) -> Finished:
    """Take both out of D, (T, 3) with the lamps' lobes off.

    material : (T,) int32, -1 for none; rho_s, alpha : (M,), NaN where unobserved; tint : (M, 3)
    covered : what the pixels cover, whose blur is to be taken out; None: it stays
    """
    notes: list[str] = []
    radiance, highlight = np.zeros(3), room(diffuse.shape, np.float32)
    highlight[:] = 0
    if ambient and len(lights) and np.isfinite(rho_s).any():
        rho, shininess = np.nan_to_num(rho_s), np.nan_to_num(alpha, nan=1.0)
        view = observations.view
        open_ = openness(observations.texels, view.faces, view.coefficients, view.normal)
        found = ambient_light(observations, diffuse, material, rho, shininess, tint, lights, open_)
        radiance = found.radiance
        if radiance.any():
            notes.append(f"ambient light {radiance.mean():.3f} of a lamp's")
            for block in blocks(len(diffuse)):
                own = np.maximum(material[block], 0)
                share = highlight_share(open_[block], rho[own], shininess[own])
                share = share * (material[block] >= 0)
                shines = (share[:, None] * tint[own] * radiance).astype(np.float32)
                highlight[block] = np.minimum(shines, np.nan_to_num(diffuse[block]))
        else:
            notes.append("no ambient light is seen")
    diffuse = rowwise(np.subtract, diffuse, highlight)
    if covered is not None:
        diffuse = sharpen(observations.texels, diffuse, covered.covariance, covered.noise)
    return Finished(diffuse, radiance, highlight, notes)
