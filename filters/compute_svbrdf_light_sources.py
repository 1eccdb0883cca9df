"""The main light sources, found in the environment map."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.environment import EnvironmentMap
from meshlab_svbrdf.reflectance.lights import lights_by_median_cut, lights_by_peaks

from ._lights import doubt, set_lights

MOST = 32
"""Lights that are kept: more are noise, and each adds four unknowns to every later fit."""

FILTER = Filter(
    name="compute_svbrdf_light_sources",
    title="SVBRDF: light sources",
    needs=("texels", "threshold", "environment"),
    writes=("lights",),
    parameters=(
        Parameter(
            "method", "enum", "peaks", choices=("peaks", "median_cut"),
            help='"peaks": blobs of the unclipped map; "median_cut": the paper\'s clustering.',
        ),
        Parameter(
            "level", "float", 0.3, minimum=0.05, maximum=0.95,
            help="Of the 99.95th percentile, above which a pixel belongs to a light (peaks).",
        ),
        Parameter(
            "faint", "float", 0.1, minimum=0.0, maximum=0.95,
            help="Blobs that only show above this lower level are weak or large lamps (peaks); set "
            "it to `level` to look for none.",
        ),
        Parameter(
            "count", "int", 4096, minimum=16, maximum=65536,
            help="Directional lights of the median cut; larger cells than 4π/count are dropped.",
        ),
        Parameter(
            "minimum_energy", "float", 0.05, minimum=0.0, maximum=1.0,
            help="Lights with less than this share of the strongest one's energy are dropped; "
            "0 keeps all.",
        ),
    ),
    help="Finds the light sources with their shapes (covariance in the tangent plane) in the map: "
    "lights.json, and rings on the `environment` layer.",
    reference="Palma et al. 2012, §7; Debevec 2005",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    environment = EnvironmentMap(
        document.array("environment_radiance"),
        document.image("environment").astype(np.float64),
        document.array("environment_weight"),
    )
    if parameters.method == "peaks":
        lights = lights_by_peaks(
            environment, parameters.level, parameters.minimum_energy, parameters.faint
        )
    else:
        lights = lights_by_median_cut(environment, parameters.count, parameters.minimum_energy)
    found = len(lights)
    lights = lights[:MOST]
    document.set_json(
        "lights_found",
        {
            "lights": [
                {
                    "direction": light.direction,
                    "covariance": light.covariance,
                    "energy": light.energy,
                }
                for light in lights
            ]
        },
    )
    set_lights(document, lights, environment.probability)
    if not lights:
        return "no light found: nothing is brighter than the threshold"
    said = f"{found} found"
    if found > MOST:
        said += (
            f", the strongest {MOST} kept: the map is noise rather than lamps; film brighter, or "
            "raise level"
        )
    why = doubt(document)
    return f"{said}; do not trust them: {why}" if why else said
