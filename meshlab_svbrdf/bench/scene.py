"""The workload's object under its lamps: frames as a camera records them, and the truth of D."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.raster import rasterise
from ..geometry.texels import Texels
from ..geometry.visibility import directional_visibility
from ..samples.luminance import encode
from .body import body
from .shading import shade, texel_diffuse

AMBIENT = 0.06
LAMPS = np.array(  # azimuth, elevation (degrees), distance, intensity at the origin
    [[38, 48, 9.0, 1.05], [-62, 14, 11.0, 0.70], [170, 38, 8.5, 0.90]]
)
MATERIALS = (("matte", 0.0, 1), ("glaze", 0.40, 60), ("bronze", 0.25, 20))  # ρs, α
COLOURS = np.array(  # two a material, linear
    [
        [[0.42, 0.16, 0.09], [0.62, 0.42, 0.28]],
        [[0.05, 0.14, 0.30], [0.45, 0.50, 0.48]],
        [[0.16, 0.10, 0.04], [0.38, 0.26, 0.12]],
    ]
)
BACKGROUND = 97.5  # a grey code, and a half to round by
NOISE = 1 << 18  # how many numbers of noise there are; a frame starts anywhere among them
_STEPS = 1 << 14
_TO_CODE = (255 * encode(np.arange(_STEPS + 1) / _STEPS)).astype(np.float32)
_RHO_S, _ALPHA = (np.array(column) for column in list(zip(*MATERIALS, strict=True))[1:])


class BenchScene:
    """triangles : about how many; noise : standard deviation in code values; seed : of the noise.

    The object's coordinates are the world's: centre near 0, radius about 1, +Y up.
    """

    def __init__(self, triangles: int, noise: float = 1.0, seed: int = 0) -> None:
        self.triangles, self.seed = triangles, seed
        normal = np.random.default_rng([seed, 1]).standard_normal(NOISE)
        self.noise = (noise * normal).astype(np.float32)
        azimuth, elevation = np.radians(LAMPS[:, :2].T)
        flat = np.cos(elevation)
        direction = np.stack([flat * np.sin(azimuth), np.sin(elevation), flat * np.cos(azimuth)])
        place = direction.T * LAMPS[:, 2:3]
        # What counts is intensity over distance², and 1 at the origin
        self.lamps = np.column_stack([place, LAMPS[:, 3] * LAMPS[:, 2] ** 2])

    @cached_property
    def mesh(self) -> Mesh:
        return body(self.triangles)

    @property
    def reach(self) -> float:
        """Distance of the farthest vertex from the origin."""
        return float(np.linalg.norm(self.mesh.vertices, axis=1).max())

    @cached_property
    def seen(self) -> np.ndarray:
        """Which vertices see which lamps, (V, 3) float64: shadows are interpolated from there."""
        lights = [(place / np.linalg.norm(place), place) for place in self.lamps[:, :3]]
        normals = self.mesh.vertex_normals()
        return directional_visibility(self.mesh, self.mesh.vertices, normals, lights).astype(float)

    def frame(self, camera: Camera, index: int, noise: bool = True, gloss: bool = True):
        """What the camera records, (H, W, 3) uint8 sRGB; index : of the frame, for its noise."""
        mesh = self.mesh
        _, face_index = rasterise(mesh.vertices, mesh.faces, camera)
        out = np.empty((camera.height, camera.width, 3), np.uint8)
        shift = int(np.random.default_rng([self.seed, 2, index]).integers(NOISE))
        shade(
            face_index, mesh.vertices @ camera.R.T + camera.t, mesh.vertices, self._normals,
            self.seen, mesh.faces, (camera.fx, camera.fy, camera.cx, camera.cy), camera.center,
            self.lamps, AMBIENT, COLOURS, _RHO_S, _ALPHA, BACKGROUND, _TO_CODE,
            self.noise if noise else np.zeros_like(self.noise), shift, gloss, out,
        )  # fmt: skip
        return out

    def covers(self, camera: Camera) -> np.ndarray:
        """Which pixels show the object, (H, W) bool, its outline left out."""
        _, face_index = rasterise(self.mesh.vertices, self.mesh.faces, camera)
        return cv2.erode((face_index >= 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0

    def truth(self, texels: Texels) -> tuple[np.ndarray, np.ndarray]:
        """The true D of each texel (T, 3), linear, 1 = 255; its material (T,), of MATERIALS."""
        D, kind = np.empty((len(texels), 3)), np.empty(len(texels), np.int32)
        texel_diffuse(
            self.mesh.vertices, self._normals, self.seen, self.mesh.faces, texels.face,
            texels.barycentric.astype(np.float64), self.lamps, AMBIENT, COLOURS, D, kind,
        )  # fmt: skip
        return D, kind

    @cached_property
    def _normals(self) -> np.ndarray:
        return self.mesh.vertex_normals()
