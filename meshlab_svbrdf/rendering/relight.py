"""The object under any light: Σ_k c_k V_k (a (n·l_k) + ρ (l_k·r)₊^α)/|L_k|², from any camera.

Shadows of lamps are looked for at every pixel; those of the many lights that an environment is cut
into, at the vertices, once for all views.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..geometry.mesh import Mesh
from ..geometry.visibility import VERTEX_OFFSET, directional_visibility
from ..jit import kernel
from ..reflectance.lamp_shadows import lamp_share
from ..reflectance.microfacet import PHONG
from ..threads import thread_count
from .environment_lights import Illumination, together
from .highlight import highlight_of
from .surface import Appearance, Seen, SurfaceRenderer

PIECE = 1 << 14
"""Pixels shaded at once by one thread."""
NEGLIGIBLE = 1e-4
"""Share of a highlight's top below which it is left out."""


@kernel
def _shade(
    corner, weight, position, normal, view, albedo, tint, kind, facing, grazing, shape,
    direction, curvature, color, lit, at_vertices, out,
):  # fmt: skip
    """Sum what the lights give to each of N points.

    corner : (N, 3) vertices around it, and weight : (N, 3)
    lit : (N, S) float64, what arrives of the first S lights; at_vertices : (V, L − S) uint8, the
        others; both empty: all arrive
    """
    sharp, shadows = lit.shape[1], lit.shape[1] + at_vertices.shape[1] > 0
    for n in range(len(out)):
        nv, red, green, blue = 0.0, 0.0, 0.0, 0.0
        for a in range(3):
            nv += normal[n, a] * view[n, a]
        a, b, c = corner[n, 0], corner[n, 1], corner[n, 2]
        u, v, w = weight[n, 0], weight[n, 1], weight[n, 2]
        glossy = facing[n] + grazing[n] > 0
        # A Phong lobe is left out where cos^α is negligible
        least = NEGLIGIBLE ** (1 / max(shape[n], 1e-3)) if kind[n] == PHONG else -1.0
        for k in range(len(curvature)):
            share = 1.0
            if shadows and k < sharp:
                share = lit[n, k]
            elif shadows:
                j = k - sharp
                share = u * at_vertices[a, j] + v * at_vertices[b, j] + w * at_vertices[c, j]
            if not share > 0:
                continue
            x = direction[k, 0] - curvature[k] * position[n, 0]
            y = direction[k, 1] - curvature[k] * position[n, 1]
            z = direction[k, 2] - curvature[k] * position[n, 2]
            length2 = x * x + y * y + z * z
            scale = 1.0 / np.sqrt(length2)
            nl = (normal[n, 0] * x + normal[n, 1] * y + normal[n, 2] * z) * scale
            if nl <= 0:
                continue
            gloss = 0.0
            if glossy:
                lv = (view[n, 0] * x + view[n, 1] * y + view[n, 2] * z) * scale
                if 2.0 * nv * nl - lv > least:
                    gloss = highlight_of(kind[n], facing[n], grazing[n], shape[n], nl, nv, lv)
            share /= length2
            red += share * color[k, 0] * (albedo[n, 0] * nl + tint[n, 0] * gloss)
            green += share * color[k, 1] * (albedo[n, 1] * nl + tint[n, 1] * gloss)
            blue += share * color[k, 2] * (albedo[n, 2] * nl + tint[n, 2] * gloss)
        out[n, 0], out[n, 1], out[n, 2] = red, green, blue


class RelitRenderer(SurfaceRenderer):
    """Renders one object from many cameras under given light.

    Parameters
    ----------
    mesh : world coordinates, with texture coordinates
    appearance : one per texture, with the albedo as its diffuse colour
    light : what shines on it
    shadows : whether the object casts them on itself
    lamp_radius : degrees, of the lamps as seen from the centre: shadows have penumbrae then
    """

    def __init__(
        self,
        mesh: Mesh,
        appearance: Sequence[Appearance],
        light: Illumination,
        shadows: bool = True,
        lamp_radius: float = 0.0,
    ):
        super().__init__(mesh, appearance)
        self.size = np.radians(lamp_radius)
        self.sharp, self.soft = light.only(~light.soft), light.only(light.soft)
        self.illumination, self.shadows = together([self.sharp, self.soft]), shadows
        self.at_vertices = np.zeros((len(mesh.vertices), 0), np.uint8)
        if shadows:
            vertices, normals = self.mesh.vertices, self.mesh.vertex_normals()
            seen = directional_visibility(
                self.rays,
                vertices,
                normals,
                [(d, None) for d in self.soft.direction],
                offset=VERTEX_OFFSET,
            )
            self.at_vertices = seen.astype(np.uint8)

    def light(self, seen: Seen) -> np.ndarray:
        out, own = np.empty((len(seen.face), 3)), self.illumination
        corners = self.mesh.faces[seen.face]
        curvature = own.curvature / self.radius
        sharp = range(len(self.sharp) if self.shadows else 0)

        def piece(first: int) -> None:
            s = slice(first, first + PIECE)
            lit = np.empty((len(seen.face[s]), len(sharp)))
            for k in sharp:
                lit[:, k] = lamp_share(
                    self.rays, seen.position[s], seen.normal[s], own.direction[k], curvature[k],
                    self.size,
                )  # fmt: skip
            _shade(
                corners[s], seen.barycentric[s], seen.position[s], seen.normal[s], seen.view[s],
                seen.diffuse[s], seen.tint[s], seen.kind[s], seen.facing[s], seen.grazing[s],
                seen.shape[s], own.direction, curvature, own.color, lit,
                self.at_vertices, out[s],
            )  # fmt: skip

        with ThreadPoolExecutor(thread_count()) as pool:
            list(pool.map(piece, range(0, len(out), PIECE)))
        return out
