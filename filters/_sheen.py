"""The sheen of materials without a lamp's highlight, in the document."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.sheen import Sheen, find_sheen
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.observations import with_normals

from ._maps import set_scalar_map
from ._stages import counted, read_observations


def seek_sheen(
    document: Document, labels: np.ndarray, observed: np.ndarray, normal: np.ndarray | None,
    progress: Progress,
) -> Sheen | None:  # fmt: skip
    """The sheen, if none of the materials is `observed` (M,): if none shows a lamp.

    normal : (T, 3), corrected; None: the mesh's
    """
    if observed.any():
        return None
    observations = read_observations(document, visibility=False)
    if normal is not None:
        observations = with_normals(observations, normal)
    return find_sheen(observations, labels, ~observed, progress=counted(progress, "sheen"))


def set_sheen(document: Document, sheen: Sheen, ids: np.ndarray) -> dict[str, Any]:
    """Write strengths, levels and normals; what materials.json says of it."""
    document.set_attribute("sheen", sheen.strength)
    document.set_attribute("sheen_level", sheen.level)
    document.set_attribute("refined_normal", sheen.normal)
    set_scalar_map(document, "sheen", document.texels(), sheen.strength, shown="sheen")
    return {
        "harmonics": sheen.coefficients,
        "normals_prior_degrees": float(np.degrees(sheen.sigma)),
        "materials": [
            {"id": int(k), "gain": float(gain)}
            for k, gain in zip(ids, sheen.gains, strict=True)
            if np.isfinite(gain)
        ],
    }


def sheen_note(sheen: Sheen, ids: np.ndarray, labels: np.ndarray) -> str:
    """What is said of it in the outcome."""
    shown = np.isfinite(sheen.strength)
    having = ids[np.unique(labels[shown])]
    return (
        f"sheen of the surroundings on materials {having.tolist()}: takes "
        f"{np.nanmax(sheen.gains):.0%} of the variance from unseen frames"
        + (
            f", normals searched within {2 * np.degrees(sheen.sigma):.0f}°"
            if sheen.sigma > 0
            else ""
        )
    )


def with_sheen(document: Document, looks: list[Appearance]) -> list[Appearance]:
    """The same with the sheen, where there is any: its levels stand for D."""
    if "sheen" not in document.attributes():
        return looks
    texels, harmonics = (
        document.texels(),
        np.array(document.json("materials")["sheen"]["harmonics"]),
    )
    levels = texels.to_images((document.attribute("sheen_level") / 100).astype(np.float32))
    strengths = texels.to_images(document.attribute("sheen"))
    return [
        replace(
            look, diffuse=np.where(np.isfinite(strength)[..., None], level, look.diffuse),
            sheen=strength, harmonics=harmonics,
        )
        for look, level, strength in zip(looks, levels, strengths, strict=True)
    ]  # fmt: skip
