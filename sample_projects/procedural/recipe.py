"""What to make: the options, the lamps and materials of the scene, and the scene itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from meshlab_svbrdf.geometry.camera import Camera

from .capture import Lens, Scene, exposed, orbit
from .light import Floodlight, Material, Surface
from .paint import Atlas, albedo_image
from .shape import totem

ORBITS = (("low", 0.12, 0.3), ("high", 0.66, 1.4))  # name, elevation and start (radians)
VIEWS = ((0.9, 0.35), (2.6, 0.05), (4.1, 0.95), (5.5, 0.45))  # held out: azimuth, elevation
FLOODS = (  # name, azimuth, elevation (degrees), distance (radii), relative intensity
    ("key", 38, 48, 9.0, 1.0),
    ("fill", -62, 14, 11.0, 0.62),
    ("rim", 170, 40, 8.5, 0.8),
)
MATERIALS = (
    Material("terracotta", 0.0, 1.0),
    Material("glaze", 0.35, 60.0),
    Material("bronze", 0.2, 20.0),
)


@dataclass(frozen=True)
class Options:
    """What to make; the defaults are the committed sample.

    frames : in all orbits together, which share them equally
    width, height : of the sensor; principal : pixels off its middle; aspect : fy / fx
    samples : rays per pixel along each axis
    columns : facets around the axis (96: 20k triangles)
    texture : the maps' width
    orbits : 1 or 2, each its own folder and sequence
    near : floodlights stand at 8 to 11 radii; else infinitely far
    ambient : radiance, relative to the key light's intensity
    clipped : share of the object's pixels that the exposure clips
    noise : of the sensor, standard deviation in code values
    exposure : the frames' exposures vary by about ± this much in ln; 0 is a fixed exposure
    exif : write each frame's exposure into it
    masks : write masks/FRAME.png
    uv : whether the scan has texture coordinates
    world : (4, 4) similarity from the object (centre 0, radius 1, +Y up) to the world
    layer_matrix : leave the scan's file in the object's frame and put `world` into the project
    views : how many held-out views to render, up to 4
    """

    frames: int = 240
    width: int = 300
    height: int = 400
    principal: tuple[float, float] = (0.0, 0.0)
    aspect: float = 1.0
    samples: int = 3
    columns: int = 96
    texture: int = 512
    orbits: int = 2
    near: bool = True
    ambient: float = 0.09
    materials: tuple[Material, ...] = MATERIALS
    clipped: float = 0.005
    noise: float = 1.0
    exposure: float = 0.0
    exif: bool = False
    masks: bool = False
    uv: bool = True
    world: np.ndarray = field(default_factory=lambda: np.eye(4))
    layer_matrix: bool = False
    views: int = 4
    quality: int = 88
    seed: int = 0


TINY = Options(
    frames=60, width=120, height=160, samples=2, columns=48, texture=128, views=1, quality=95
)


def make_scene(options: Options) -> tuple[Scene, Atlas, list[list[Camera]], list[Camera]]:
    """The exposed scene, its atlas, the cameras of each orbit and of the held-out views.

    All in the object's frame: centre 0, radius 1, +Y up.
    """
    mesh, _, material = totem(options.columns, gutter=3 / options.texture)
    atlas = Atlas.of(mesh, options.texture)
    surface = Surface(mesh, material, albedo_image(mesh, material, atlas, options.seed))
    lights = [
        Floodlight(name, direction(azimuth, elevation), distance if options.near else np.inf, gain)
        for name, azimuth, elevation, distance, gain in FLOODS
    ]
    lens = Lens(options.width, options.height, options.principal, options.aspect)
    count = options.frames // options.orbits
    orbits = [
        orbit(lens, count, elevation, start, lean=k == 1, seed=[options.seed, 2, k])
        for k, (_, elevation, start) in enumerate(ORBITS[: options.orbits])
    ]
    views = [
        lens.camera(4.4 * direction(np.degrees(a), np.degrees(e)), np.zeros(3))
        for a, e in VIEWS[: options.views]
    ]
    scene = Scene(surface, lights, options.ambient, options.materials)
    scene = exposed(scene, list(chain(*orbits)), options.clipped, [options.seed, 3])
    return scene, atlas, orbits, views


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector; degrees, azimuth 0 is +Z, 90 is +X."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
