"""The object under any light: Σ_k c_k V_k (a (n·l_k) + ρ (l_k·r)₊^α)/|L_k|², from any camera.

Shadows of lamps are looked for at every pixel; those of the many lights that an environment is cut
into, at the vertices, once for all views.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit

from ..geometry.mesh import Mesh
from ..geometry.visibility import VERTEX_OFFSET, directional_visibility
from ..threads import thread_count
from .environment_lights import Illumination
from .highlight import highlight_of
from .surface import Appearance, Seen, SurfaceRenderer

PIECE = 1 << 14
"""Pixels shaded at once by one thread."""
NEGLIGIBLE = 1e-4
"""Share of a highlight's top below which it is left out."""


@njit(cache=True, nogil=True)
def _shade(
    position, normal, view, albedo, tint, kind, facing, grazing, shape,
    direction, curvature, color, visible, out,
):  # fmt: skip
    """Sum what the lights give to each point; visible (N, L) float32, the share that arrives."""
    for n in range(len(out)):
        nv, ax, ay, az = 0.0, 0.0, 0.0, 0.0
        for a in range(3):
            nv += normal[n, a] * view[n, a]
        glossy = facing[n] + grazing[n] > 0
        # A Phong lobe is left out where cos^shape is negligible
        least = NEGLIGIBLE ** (1 / max(shape[n], 1e-3)) if kind[n] == 0 else -1.0
        for k in range(len(curvature)):
            if not visible[n, k] > 0:
                continue
            x = direction[k, 0] - curvature[k] * position[n, 0]
            y = direction[k, 1] - curvature[k] * position[n, 1]
            z = direction[k, 2] - curvature[k] * position[n, 2]
            length2 = x * x + y * y + z * z
            scale = 1.0 / np.sqrt(length2)
            nl = (normal[n, 0] * x + normal[n, 1] * y + normal[n, 2] * z) * scale
            if nl <= 0:
                continue
            specular = 0.0
            if glossy:
                lv = (view[n, 0] * x + view[n, 1] * y + view[n, 2] * z) * scale
                if kind[n] != 0 or 2.0 * nv * nl - lv > least:
                    specular = highlight_of(kind[n], facing[n], grazing[n], shape[n], nl, nv, lv)
            weight = visible[n, k] / length2
            ax += weight * color[k, 0] * (albedo[n, 0] * nl + tint[n, 0] * specular)
            ay += weight * color[k, 1] * (albedo[n, 1] * nl + tint[n, 1] * specular)
            az += weight * color[k, 2] * (albedo[n, 2] * nl + tint[n, 2] * specular)
        out[n, 0], out[n, 1], out[n, 2] = ax, ay, az


class RelitRenderer(SurfaceRenderer):
    """Renders one object from many cameras under given light.

    Parameters
    ----------
    mesh : world coordinates, with texture coordinates
    appearance : one per texture, with the albedo as its diffuse colour
    light : what shines on it
    shadows : whether the object casts them on itself
    """

    def __init__(
        self,
        mesh: Mesh,
        appearance: Sequence[Appearance],
        light: Illumination,
        shadows: bool = True,
    ):
        super().__init__(mesh, appearance)
        self.illumination, self.shadows = light, shadows
        if shadows:
            vertices, normals = self.mesh.vertices, self.mesh.vertex_normals()
            seen = directional_visibility(
                self.rays, vertices, normals, self._places(light.soft), offset=VERTEX_OFFSET
            )
            self.at_vertices = seen.astype(np.float32)

    def light(self, seen: Seen) -> np.ndarray:
        out = np.empty((len(seen.face), 3))
        own = self.illumination

        def piece(first: int) -> None:
            s = slice(first, first + PIECE)
            _shade(
                seen.position[s], seen.normal[s], seen.view[s], seen.diffuse[s], seen.tint[s],
                seen.kind[s], seen.facing[s], seen.grazing[s], seen.shape[s], own.direction,
                own.curvature / self.radius, own.color, self._visible(seen, s), out[s],
            )  # fmt: skip

        with ThreadPoolExecutor(thread_count()) as pool:
            list(pool.map(piece, range(0, len(out), PIECE)))
        return out

    def _visible(self, seen: Seen, some: slice) -> np.ndarray:
        """The share (N, L) float32 of each light that arrives."""
        soft = self.illumination.soft
        visible = np.ones((len(seen.face[some]), len(soft)), np.float32)
        if self.shadows:
            visible[:, ~soft] = directional_visibility(
                self.rays, seen.position[some], seen.normal[some], self._places(~soft)
            )
            corners = self.mesh.faces[seen.face[some]]
            weights = seen.barycentric[some].astype(np.float32)
            visible[:, soft] = np.einsum("nc,ncl->nl", weights, self.at_vertices[corners])
        return visible

    def _places(self, some: np.ndarray) -> list[tuple[np.ndarray, np.ndarray | None]]:
        own = self.illumination
        return [
            (d, None if k == 0 else d * (self.radius / k))
            for d, k in zip(own.direction[some], own.curvature[some], strict=True)
        ]
