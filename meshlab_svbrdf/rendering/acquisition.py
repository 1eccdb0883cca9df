"""The object as it was lit when it was filmed: D + Σ_k ρ g_k V_k (l_k·r)₊^α, from any camera.

Where microfacets describe a material better, their highlights stand for the lobe.

D holds the lights' shading already, so it is never shaded again. Lights may stand near, and what
stands between a light and the surface takes its highlight away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.harmonics import basis
from ..geometry.mesh import Mesh
from ..reflectance.lamp_shadows import lamp_share
from ..reflectance.lights import Light
from ..reflectance.phong import lamps
from .highlight import highlight
from .surface import Appearance, Seen, SurfaceRenderer

NEGLIGIBLE = 1e-4
"""Highlights below this share of white are not looked into."""


class AcquisitionRenderer(SurfaceRenderer):
    """Renders one object from many cameras.

    Parameters
    ----------
    mesh : world coordinates, with texture coordinates
    appearance : one per texture
    lights : with gains of geometric mean 1; directions as seen from the mesh's centre
    shadows : whether lights are tested against the mesh
    lamp_radius : degrees, of compact lamps as seen from the centre: shadows have penumbrae then
    """

    def __init__(
        self,
        mesh: Mesh,
        appearance: Sequence[Appearance],
        lights: list[Light],
        shadows: bool = True,
        lamp_radius: float = 0.0,
    ):
        super().__init__(mesh, appearance)
        self.lights, self.shadows = lights, shadows
        self.size = np.radians(lamp_radius)

    def light(self, seen: Seen) -> np.ndarray:
        # Brighten D by what it mirrors of its surroundings
        diffuse, mirroring = seen.diffuse.copy(), np.flatnonzero(seen.sheen)
        if seen.harmonics is not None and len(mirroring):
            n, v = seen.normal[mirroring], seen.view[mirroring]
            mirror = 2 * np.einsum("nd,nd->n", n, v)[:, None] * n - v
            brighter = np.exp(seen.sheen[mirroring] * (basis(mirror) @ seen.harmonics))
            diffuse[mirroring] *= brighter[:, None]

        # Add the highlights of the lights that are seen
        specular, amount = np.zeros(len(diffuse)), np.empty(len(diffuse))
        bulbs = lamps(self.lights, self.radius)
        for k, (direction, gain) in enumerate(zip(bulbs.direction, bulbs.gain, strict=True)):
            toward = direction - bulbs.curvature[k] / self.radius * seen.position
            highlight(
                seen.kind, seen.facing, seen.grazing, seen.shape, seen.normal, seen.view, toward,
                gain, amount,
            )  # fmt: skip
            amount[amount < NEGLIGIBLE] = 0
            lit = np.flatnonzero(amount)
            if self.shadows and len(lit):
                compact = (bulbs.light == bulbs.light[k]).sum() == 1
                amount[lit] *= lamp_share(
                    self.rays, seen.position[lit], seen.normal[lit], direction,
                    bulbs.curvature[k] / self.radius, self.size if compact else 0.0,
                )  # fmt: skip
            specular += amount
        return diffuse + specular[:, None] * seen.tint
