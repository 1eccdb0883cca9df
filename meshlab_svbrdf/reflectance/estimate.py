"""The joint estimate from beginning to end: all lights, fit, normals, fit again, D anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..samples.observations import Observations, with_normals
from ..samples.store import Block
from .diffuse_refit import refitting
from .finish import finish_diffuse
from .footprint import Footprints, covering
from .joint import Material, fit
from .lights import Light
from .microfacet import Microfacets
from .missed_lights import complete_lights
from .models import Models, choose_models, described
from .normal_refinement import refine_normals

CORRECTIONS = 2
"""At most, of the normals; after each everything is fitted again."""


@dataclass(frozen=True)
class Estimate:
    """The reflectance of an object.

    materials : one per id; lights : with gains of geometric mean 1
    diffuse : (T, 3) float32, linear RGB 0..100, the highlights taken off
    ambient : (3,) radiance from everywhere, for lamps of mean gain 1; 0 where it is not seen
    ambient_highlight : (T, 3) float32, 0..100, what it adds to D by its highlight
    normal : (T, 3) float32, corrected; None where they are kept
    microfacets : one per material, where they describe it better than Phong's lobe; D is theirs
    notes : what is to be said about it
    """

    materials: list[Material]
    lights: list[Light]
    diffuse: np.ndarray
    ambient: np.ndarray
    ambient_highlight: np.ndarray
    normal: np.ndarray | None
    microfacets: list[Microfacets | None]
    notes: list[str]


def estimate(
    observations: Observations,
    material: np.ndarray,
    lights: list[Light],
    diffuse: np.ndarray,
    turn: np.ndarray,
    footprint: float,
    *,
    complete: bool = True,
    correct_normals: bool = True,
    ambient: bool = True,
    sharp: bool = True,
    microfacets: bool = True,
    progress: Callable[[float, str], None] = lambda share, what: None,
    **options,
) -> Estimate:
    """Materials, lights, diffuse colour and normals that explain the samples together.

    Parameters
    ----------
    material : (T,) int32, -1 for none; lights : from the environment map
    diffuse : (T, 3), the statistical D; it stays where a material is unobserved
    turn, footprint, options : see `joint.fit`
    complete : whether lights are looked for that the environment map does not show
    ambient, sharp : whether the ambient light's highlight and the pixels' blur are taken out of D
    microfacets : whether they may describe a material instead of Phong's lobe
    """

    def part(start: float, stop: float, what: str) -> Callable[[int, int], None]:
        return lambda done, total: progress(start + (stop - start) * done / max(total, 1), what)

    notes: list[str] = []
    known: dict | None = None
    if complete:
        lights, known, notes = complete_lights(
            observations, material, lights, turn, footprint, **options
        )
    corrected = None
    step = 0.75 / (1 + CORRECTIONS)
    for k in range(1 + CORRECTIONS):
        found = fit(
            observations, material, lights, turn, footprint, **options, known=known,
            progress=part(step * k, step * (k + 0.5), "fitting"),
        )  # fmt: skip
        lights, known = found.lights, found.rounds[-1] if found.rounds else None
        columns = [(m.rho_s, m.alpha, m.noise) for m in found.materials]
        rho_s, alpha, noise = np.array(columns).reshape(-1, 3).T
        if not correct_normals or k == CORRECTIONS:
            break
        better = refine_normals(
            observations, material, rho_s, alpha, noise, lights,
            progress=part(step * (k + 0.5), step * (k + 1), "normals"),
        )  # fmt: skip
        if better.sigma == 0:
            break
        notes.append(
            f"normals corrected by {np.degrees(better.turned):.2f}°, which takes {better.gain:.0%} "
            "of the error from unseen samples"
        )
        corrected = better.normal
        observations = with_normals(observations, corrected)
    chosen = Models([None] * len(found.materials), found.materials, lights, [])
    if microfacets:
        progress(0.75, "microfacets")
        chosen = choose_models(
            observations, material, found.materials, lights, turn, footprint, **options
        )
    gloss, tint = described(chosen.materials, chosen.microfacets)
    refit = refitting(observations, diffuse, material, gloss, tint, chosen.lights)
    if observations.rays is not None:
        observations.rays.rest()
    refitted, *covered = observations.store.rows(
        partial(_both, refit, covering(observations)), part(0.8, 0.9, "diffuse colour")
    )
    rho_s, alpha = np.array([(m.rho_s, m.alpha) for m in chosen.materials]).reshape(-1, 2).T
    done = finish_diffuse(
        observations, refitted, material, rho_s, alpha, tint, chosen.lights,
        ambient=ambient, covered=Footprints(*covered) if sharp else None,
    )  # fmt: skip
    return Estimate(
        chosen.materials, chosen.lights, done.diffuse, done.ambient, done.highlight, corrected,
        chosen.microfacets, notes + found.notes + chosen.notes + done.notes,
    )  # fmt: skip


def _both(
    first: Callable[[Block], tuple[np.ndarray, ...]],
    then: Callable[[Block], tuple[np.ndarray, ...]],
    block: Block,
) -> tuple[np.ndarray, ...]:
    """Two works on a block that is read once."""
    return *first(block), *then(block)
