"""Finding the clusters: what the filter does, and the page of `meshlab-svbrdf view` with it."""

from __future__ import annotations

from functools import partial

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.gloss_areas import by_gloss
from meshlab_svbrdf.reflectance.materials import MOST, color_space, segment_surface
from meshlab_svbrdf.threads import side_by_side

from ._stages import read_curved_observations, read_lights_found

FOLLOWED = 2.0
"""Thresholds within which a cluster without a gloss of its own follows the nearest colour."""


def find_clusters(
    document: Document, progress: Progress, *, threshold: float, lightness_weight: float,
    minimum_share: float, join: bool, gloss: bool,
) -> tuple[np.ndarray, str]:  # fmt: skip
    """Labels (T,) int32, -1 for none, and in words what gloss changed of those of colour."""
    texels, diffuse = document.texels(), document.attribute("diffuse")
    progress(0.1, "growing regions")
    adjacency = None
    if len(texels) <= MOST and np.isfinite(diffuse).all():  # regions grow over all of them
        adjacency = neighbours(texels.position, texels.normal)
    grow = partial(
        segment_surface, texels.position, texels.normal, diffuse, adjacency=adjacency,
        threshold=threshold, lightness_weight=lightness_weight, minimum_share=minimum_share,
        join=join,
    )  # fmt: skip
    lights = read_lights_found(document) if gloss else []
    if not lights:
        return grow(), "by colour alone: no light was found" if gloss else ""
    labels, (observations, turn), colors = side_by_side(
        grow,
        lambda: read_curved_observations(document, rays=True, adjacency=adjacency),
        lambda: color_space(diffuse, lightness_weight),
    )
    if labels.max(initial=-1) < 0:
        return labels, ""
    progress(0.3, "comparing highlights")
    glossy = by_gloss(observations, labels, colors, lights, turn, FOLLOWED * threshold)
    if observations.rays is not None:
        observations.rays.rest()
    return glossy, f"of {labels.max() + 1} by colour"
