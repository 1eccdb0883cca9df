"""What lights add to surface points by their highlights: a Phong lobe, or microfacets."""

from __future__ import annotations

import numpy as np

from ..jit import kernel
from ..reflectance.microfacet import PHONG, facets

GRAZING = 1e-3
"""Cosine below which microfacets show nothing."""


@kernel
def highlight_of(kind, facing, grazing, shape, nl, nv, lv):
    """ρ (l·r)^α, or microfacets' value, from the cosines of light, view and normal; nl > 0."""
    if kind == PHONG:
        return facing * max(2.0 * nv * nl - lv, 0.0) ** shape
    if nv > GRAZING and nl > GRAZING:
        value, fresnel = facets(kind, shape, nl, nv, lv)
        return value * (facing + grazing * fresnel)
    return 0.0


@kernel
def highlight(kind, facing, grazing, shape, normal, view, toward, gain, out):
    """What one light of `gain` adds by its highlight; toward (N, 3) is L, not of unit length."""
    for n in range(len(out)):
        out[n] = 0.0
        if not facing[n] + grazing[n] > 0:
            continue
        nl, nv, lv, length2 = 0.0, 0.0, 0.0, 0.0
        for a in range(3):
            nl += normal[n, a] * toward[n, a]
            nv += normal[n, a] * view[n, a]
            lv += view[n, a] * toward[n, a]
            length2 += toward[n, a] * toward[n, a]
        scale = 1.0 / np.sqrt(length2)
        nl, lv = nl * scale, lv * scale
        if nl > 0:
            value = highlight_of(kind[n], facing[n], grazing[n], shape[n], nl, nv, lv)
            out[n] = gain / length2 * value
