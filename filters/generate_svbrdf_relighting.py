"""The object under other light than the acquisition's, from the cameras of a project."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr
from meshlab_svbrdf.document.light_files import LightEntry, read_light_file
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.directions import solid_angles
from meshlab_svbrdf.rendering.environment_lights import (
    LIGHTS,
    Illumination,
    cut_environment,
    together,
    uniform_light,
)
from meshlab_svbrdf.rendering.relight import RelitRenderer

from ._lights import read_lights
from ._views import BACKGROUND, LAMP_RADIUS, REFLECTANCE, VIEWS, render_views, views
from .generate_svbrdf_rendering import read_appearance

FILTER = Filter(
    name="generate_svbrdf_relighting",
    title="SVBRDF: render under other light",
    needs=("mesh", "texels", "material_specular", "albedo"),
    needs_if={"environment": ("recovered", True)},
    parameters=(
        *VIEWS,
        Parameter(
            "lights", "path", "",
            help="A JSON file of lights in the form of a result's lights.json: direction or "
            "position, gain, and color where one is not white; `ambient` is what comes from "
            "everywhere.",
        ),
        Parameter(
            "environment", "path", "",
            help="An HDR map of the surroundings, OpenEXR, latitude-longitude, its pole up along "
            "+Y; or empty.",
        ),
        Parameter(
            "recovered", "bool", False,
            help="The environment map that was recovered from the film, as bright as the lamps "
            "found are together, and the ambient light. Its lamps are as wide as the highlights "
            "that showed them.",
        ),
        Parameter(
            "directions", "int", LIGHTS, minimum=1, maximum=4096,
            help="Far lights that stand for the surroundings: regions of equal energy.",
        ),
        Parameter(
            "turn", "float", 0.0, minimum=-360.0, maximum=360.0, unit="degrees",
            help="By which the surroundings turn about +Y, from +Z towards +X.",
        ),
        Parameter(
            "exposure", "float", 0.0, minimum=-20.0, maximum=20.0, unit="stops",
            help="Brighter by 2 to this power.",
        ),
        Parameter("shadows", "bool", True, help="Whether the object shades itself."),
        LAMP_RADIUS,
        REFLECTANCE,
        BACKGROUND,
    ),
    help="Renders Σ c V (albedo n·l + ρ (l·r)^α) under given lights, an environment map, or "
    "the recovered one. Brightness is up to one scale, which nothing in the frames tells: set the "
    "exposure.",
    reference="Palma et al. 2012, §8; Debevec 2005 (median cut)",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    wanted = views(document, parameters)
    light = illumination(document, parameters)
    albedo = document.map("albedo")
    appearance = [
        replace(each, diffuse=own, sheen=None, harmonics=None)
        for each, own in zip(
            read_appearance(document, parameters.reflectance == "best"), albedo, strict=True
        )
    ]
    progress(0.0, "shadows")
    renderer = RelitRenderer(
        document.mesh(), appearance, light, parameters.shadows, parameters.lamp_radius
    )
    return f"{render_views(renderer, wanted, parameters, progress)}, {len(light)} lights"


def illumination(document: Document, parameters: Namespace) -> Illumination:
    """What shines, by the parameters; SvbrdfError where nothing does."""
    if parameters.lights is None and parameters.environment is None and not parameters.recovered:
        raise SvbrdfError("neither lights nor an environment is given: say what shines")
    parts = [_recovered(document, parameters.directions)] if parameters.recovered else []
    if parameters.lights is not None:
        lights = read_light_file(parameters.lights)
        parts.append(lamps_of(document, lights.lamps))
        if lights.ambient.any():
            parts.append(uniform_light(lights.ambient, parameters.directions))
    if parameters.environment is not None:
        radiance = read_exr(parameters.environment).astype(float)
        if radiance.ndim == 2:
            radiance = np.repeat(radiance[..., None], 3, axis=-1)
        if radiance.shape[1] != 2 * radiance.shape[0] or not np.isfinite(radiance).all():
            height, width = radiance.shape[:2]
            raise SvbrdfError(
                f"{parameters.environment}: {width}×{height} pixels; expected finite radiances "
                "in latitude-longitude, twice as wide as high"
            )
        parts.append(cut_environment(radiance, parameters.directions, parameters.turn))
    light = together(parts)
    return replace(light, color=light.color * 2.0**parameters.exposure)


def _recovered(document: Document, directions: int) -> Illumination:
    """The recovered map, its energy that of the lamps, and the ambient light where it is known."""
    radiance = np.maximum(document.array("environment_radiance").astype(float), 0)
    energy = (radiance * solid_angles(len(radiance))).sum() / np.pi
    if not energy > 0:
        raise SvbrdfError("the recovered environment map is black: give lights or an environment")
    gain = sum(lamp.gain for lamp in read_lights(document)) / energy
    ambient = document.json("lights")["ambient"]
    around = np.zeros(3) if ambient is None else np.array(ambient, float)
    return cut_environment(gain * radiance[..., None] + around, directions)


def lamps_of(document: Document, entries: Sequence[LightEntry]) -> Illumination:
    """Lamps of a file as they stand around the object; SvbrdfError where one is within it."""
    center, radius = document.array("texels_center"), float(document.array("texels_radius"))
    direction, curvature = np.zeros((len(entries), 3)), np.zeros(len(entries))
    for k, entry in enumerate(entries):
        if entry.position is None:
            direction[k] = entry.direction
            continue
        away = entry.position * radius if entry.in_radii else entry.position - center
        distance = float(np.linalg.norm(away))
        if not distance > radius:
            raise SvbrdfError(
                f"light {k} stands {distance:.3g} from the object's centre, within its radius of "
                f"{radius:.3g}"
            )
        direction[k], curvature[k] = away / distance, radius / distance
    color = np.array([entry.color for entry in entries])
    return Illumination(direction, curvature, color, np.zeros(len(entries), bool))
