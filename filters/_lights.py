"""lights.json, the lights' marks on the environment sphere, and whether to trust them."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.reflectance.lights import TRUSTED_SAMPLES, Light

from ._sphere import set_environment_layer


def set_lights(
    document: Document,
    lights: list[Light],
    probability: np.ndarray,
    ambient: np.ndarray | None = None,
) -> None:
    """Stage lights.json and the sphere that shows them.

    ambient : (3,) radiance from everywhere, for lamps of mean gain 1; None where it is not known
    """
    center, radius = document.array("texels_center"), float(document.array("texels_radius"))
    document.set_json(
        "lights",
        {
            "lights": [
                {
                    "direction": light.direction, "position": light.position(center, radius),
                    "gain": light.gain, "covariance": light.covariance, "half_length": light.bar,
                    "half_breadth": light.breadth,
                }
                for light in lights
            ],
            "ambient": ambient,
        },
    )  # fmt: skip
    set_environment_layer(document, probability, lights)


def read_lights(document: Document) -> list[Light]:
    """The lights of lights.json, as the last filter that moved them left them."""
    center, radius = document.array("texels_center"), float(document.array("texels_radius"))
    lights = []
    for entry in document.json("lights")["lights"]:
        position = entry["position"]
        distance = np.inf if position is None else np.linalg.norm(np.array(position) - center)
        lights.append(
            Light(
                np.array(entry["direction"]), np.array(entry["covariance"]), entry["gain"],
                0.0 if position is None else radius / float(distance),
                bar=np.array(entry["half_length"]), breadth=entry.get("half_breadth", 0.0),
            )
        )  # fmt: skip
    return lights


def doubt(document: Document) -> str:
    """Why lights that were found are not to be trusted: for want of frames; else nothing."""
    seen = document.attribute("samples")
    median = int(np.quantile(seen[seen > 0], 0.5, method="lower")) if seen.any() else 0
    if median >= TRUSTED_SAMPLES:
        return ""
    return (
        f"a texel is seen by {median} frames, and by fewer than {TRUSTED_SAMPLES} lights may be "
        "false or degrees off, and gloss with them: take more from all around"
    )
