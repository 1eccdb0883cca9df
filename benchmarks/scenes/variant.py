"""What a scene is made of: lamps, materials, and everything that degrades its frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np


@dataclass(frozen=True)
class Lamp:
    """A flat emitter that faces the object's centre.

    azimuth, elevation : degrees; azimuth 0 is +Z, 90 is +X
    distance : object radii
    half_extent : degrees, as seen from the centre, along two axes
    intensity : what a surface facing it receives at the centre, over π; relative to the others
    turn : degrees, of the first axis against the horizon
    """

    name: str
    azimuth: float
    elevation: float
    distance: float
    half_extent: tuple[float, float] = (2.5, 2.5)
    intensity: float = 1.0
    turn: float = 0.0
    kind: str = "disk"

    @property
    def direction(self) -> np.ndarray:
        a, e = np.radians([self.azimuth, self.elevation])
        return np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])

    @property
    def position(self) -> np.ndarray:
        return self.distance * self.direction

    @property
    def half_axes(self) -> np.ndarray:
        """Two vectors (2, 3) from the lamp's middle to its rim; their cross product faces home."""
        across = np.cross([0.0, 1.0, 0.0], -self.direction)
        across /= np.linalg.norm(across)
        along = np.cross(-self.direction, across)
        c, s = np.cos(np.radians(self.turn)), np.sin(np.radians(self.turn))
        lengths = self.distance * np.tan(np.radians(self.half_extent))
        return np.array([c * across + s * along, c * along - s * across]) * lengths[:, None]

    def radiance(self) -> float:
        """Radiance that gives `intensity`: π·intensity / ∫ cos²/d² dA, the lamp facing the centre.

        Both cosines are distance/d.
        """
        t = (np.arange(400) + 0.5) / 200 - 1
        u, v = np.meshgrid(t, t)
        inside = u * u + v * v <= 1 if self.kind == "disk" else np.ones_like(u, bool)
        lengths = np.linalg.norm(self.half_axes, axis=1)
        square = self.distance**2 + (u * lengths[0]) ** 2 + (v * lengths[1]) ** 2
        area = lengths[0] * lengths[1] * (t[1] - t[0]) ** 2
        return float(np.pi * self.intensity / (area * (self.distance**2 / square**2)[inside].sum()))


@dataclass(frozen=True)
class Material:
    """Colours are linear albedos, mixed by a cloudy pattern.

    rho_s, alpha : the paper's lobe; None for materials that Phong only approximates
    plastic, gold : roughness of a dielectric layer over the colour, or of gold
    distribution : of their microfacets
    """

    name: str
    rho_s: float | None
    alpha: float | None
    dark: tuple[float, float, float]
    bright: tuple[float, float, float]
    plastic: float | None = None
    gold: float | None = None
    distribution: ClassVar[str] = "beckmann"


class GgxMaterial(Material):
    """One with longer tails."""

    distribution: ClassVar[str] = "ggx"


@dataclass(frozen=True)
class Variant:
    """One scene; equal variants give equal files.

    shape : bumpy, vessel, bowl or knot; detail : of its mesh, about quads along one axis
    coarse : the project's mesh has this factor less triangles than the one rendered
    ambient : radiance from everywhere, relative to a lamp of intensity 1
    arc : degrees that each of the two orbits sweeps; elevations : degrees, of the orbits
    clipped : share of the object's pixels that the exposure clips
    noise : standard deviation in code values; quality : of the JPEG files
    pose_error : pixels, standard deviation on the object, in the project only
    exposure : frames' exposures vary by about ± this much in ln; exif : whether they say so
    depth : path length; 2 is direct light (the truth of the diffuse colour is direct light's)
    offset : where the object stands in the world, along all axes; z_up : its up is the world's +Z
    """

    name: str
    about: str
    shape: str
    lamps: tuple[Lamp, ...]
    materials: tuple[Material, ...]
    ambient: float = 0.08
    detail: int = 40
    coarse: float = 1.0
    frames: int = 160
    arc: float = 360.0
    elevations: tuple[float, float] = (8.0, 36.0)
    width: int = 320
    height: int = 240
    samples: int = 9
    texture: int = 512
    clipped: float = 0.01
    noise: float = 0.0
    quality: int = 93
    pose_error: float = 0.0
    exposure: float = 0.0
    exif: bool = False
    depth: int = 2
    offset: float = 0.0
    z_up: bool = False
    views: int = 6
    seed: int = 1
