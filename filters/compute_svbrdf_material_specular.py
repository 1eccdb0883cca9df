"""ρs and α of every material, by the paper's statistics or by the joint fit."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.blocks import counted, taken
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.reflectance.density import highest_bell
from meshlab_svbrdf.reflectance.estimate import Estimate, estimate
from meshlab_svbrdf.reflectance.footprint import footprints
from meshlab_svbrdf.reflectance.joint import Material
from meshlab_svbrdf.reflectance.lamp_size import under_points
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.reflectance.long_lamps import as_seen
from meshlab_svbrdf.reflectance.microfacet import NAMES, Microfacets
from meshlab_svbrdf.reflectance.sharpen import sharpen
from meshlab_svbrdf.threads import side_by_side

from ._lights import set_lights
from ._maps import set_diffuse_maps, set_scalar_map
from ._materials import read_labels
from ._sheen import seek_sheen, set_sheen, sheen_note
from ._stages import read_curved_observations, read_lights_found, read_observations

FILTER = Filter(
    name="compute_svbrdf_material_specular",
    title="SVBRDF: specular per material",
    version=4,
    needs=(
        "mesh", "rasters", "texels", "visibility", "samples", "environment", "diffuse", "lights",
        "materials",
    ),
    needs_if={"texel_specular": ("estimator", "paper")},
    writes=("material_specular",),
    parameters=(
        Parameter(
            "estimator", "enum", "joint", choices=("joint", "paper"),
            help='"joint" eliminates every texel\'s diffuse term and refines the lights; '
            '"paper" takes the highest mode of the texels\' ρs.',
        ),
        Parameter(
            "gloss", "enum", "seek", choices=("seek", "none"),
            help='"none": look for no highlights; every material is unobserved, and D is what it '
            "was, but for the blur of the pixels.",
        ),
        Parameter(
            "rounds", "int", 10, minimum=3, maximum=50,
            help="Of the joint fit, at most; it ends when nothing moves by more "
            "than .1 % or a tenth of its error.",
        ),
        Parameter(
            "samples", "int", 750_000, minimum=10_000,
            help="About how many samples the joint fit holds in memory, about 60 bytes each.",
        ),
        Parameter(
            "complete", "bool", True,
            help="Look for lights that the environment map does not show (joint).",
        ),
        Parameter("near", "bool", True, help="Lights at a finite distance (joint)."),
        Parameter(
            "long", "bool", True,
            help="Tubes: the length of lamps whose blob is elongated (joint).",
        ),
        Parameter("censoring", "bool", True, help="Clipped samples count as lower bounds (joint)."),
        Parameter(
            "curvature", "float", 0.8, minimum=0.0, maximum=10.0,
            help="Leaves out texels whose normal turns within a pixel by more than c/√α (joint); "
            "0: none.",
        ),
        Parameter(
            "lens", "bool", False,
            help="Find how far lens, motion and registration blur highlights beyond what pixels "
            "do (joint). It takes a surface that bends more here and less there.",
        ),
        Parameter(
            "shadows", "enum", "rays", choices=("rays", "harmonics"),
            help="How it is told which light reaches a texel (joint): by a ray to each, or by the "
            "harmonics of the visibility, which blur.",
        ),
        Parameter(
            "normals", "enum", "auto", choices=("auto", "keep"),
            help="Correct the normals where highlights say so and the other half of the film "
            "agrees, or keep them.",
        ),
        Parameter(
            "reflectance", "enum", "auto", choices=("auto", "phong"),
            help="Describe a material by microfacets (GGX, Beckmann) where they predict samples "
            "that no fit has seen better than Phong's lobe, or always by the lobe (joint).",
        ),
        Parameter(
            "sheen", "enum", "auto", choices=("auto", "none"),
            help="Where no material shows a lamp: describe them by what they mirror of their "
            "surroundings, with normals to match, if that predicts frames that it has not seen; "
            "or do not (joint).",
        ),
        Parameter(
            "ambient", "bool", True,
            help="Take the ambient light's own faint highlight out of D (joint).",
        ),
        Parameter(
            "sharp", "bool", True,
            help="Take the blur of the frames' pixels out of D, where it is above the noise "
            "(joint).",
        ),
        Parameter(
            "lamp_radius", "float", 0.0, minimum=0.0, maximum=45.0,
            help="Degrees that the lamps' radius subtends at the object's centre, where it is "
            "known: materials.json then also tells rho_s_point and alpha_point, as under points "
            "of light; 0: not known.",
        ),
        Parameter(
            "density", "enum", "log", choices=("log", "linear"),
            help="Of ln ρs, or of ρs as the paper has it (paper).",
        ),
        Parameter(
            "bell", "enum", "median", choices=("median", "mean"),
            help="What is taken inside the bell of the highest mode; the paper takes the mean "
            "(paper).",
        ),
    ),
    help="Writes materials.json, lights.json, maps/rho_s.exr and maps/alpha.exr (NaN where "
    "unobserved; maps/roughness.exr, f0.exr and strength.exr where microfacets describe a material "
    "better) and the final maps/diffuse. A material whose samples do not determine its gloss "
    "is unobserved, and why is said.",
    reference="Palma et al. 2012, §7",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    texels, labels, diffuse = (
        document.texels(),
        read_labels(document),
        document.attribute("diffuse"),
    )
    lights = read_lights_found(document)
    count = counted(labels)
    ids, number = np.flatnonzero(count), np.full(len(count) + 1, -1, np.int32)
    number[ids] = np.arange(len(ids))
    dense = taken(number, labels)

    ambient, sheen = None, None
    notes: list[str] = []
    microfacets: list[Microfacets | None] = [None] * len(ids)
    if parameters.gloss == "none":
        why = "no highlights were looked for (gloss=none)"
        materials = [
            Material(np.nan, np.nan, False, why, texels=int((dense == m).sum()))
            for m in range(len(ids))
        ]
        if parameters.estimator == "joint" and parameters.sharp:
            observations = read_observations(document)
            covered = footprints(observations)
            diffuse = sharpen(texels, diffuse, covered.covariance, covered.noise)
    elif parameters.estimator == "paper":
        materials = [_bell(document, dense == m, parameters) for m in range(len(ids))]
    else:
        early = progress.part(0, 0.95)
        found = _joint(document, dense, ids, lights, diffuse, parameters, early)
        materials, notes, lights = found.materials, found.notes, found.lights
        diffuse, microfacets = found.diffuse, found.microfacets
        if found.ambient.any():
            ambient = found.ambient
            document.set_attribute("ambient_highlight", found.ambient_highlight)
        if found.normal is not None:
            document.set_attribute("refined_normal", found.normal)
        if parameters.sheen == "auto":
            pairs = zip(materials, microfacets, strict=True)
            observed = np.array([m.observed or f is not None for m, f in pairs], bool)
            sheen = seek_sheen(document, dense, observed, found.normal, progress.part(0.95, 1))
    if sheen is not None:
        notes = [*notes, sheen_note(sheen, ids, dense)]

    # Write maps, materials and lights; the maps hold what is seen, as under compact lamps
    seen = np.array([as_seen(m.rho_s, m.alpha, lights) for m in materials] + [(np.nan, np.nan)])
    rho_s, alpha = (taken(column, dense) for column in (seen / [100, 1]).astype(np.float32).T)
    document.set_attribute("final_diffuse", diffuse)
    document.set_attribute("material_rho_s", rho_s)
    document.set_attribute("material_alpha", alpha)
    brighter: list[str] = []
    side_by_side(
        lambda: brighter.extend(set_diffuse_maps(document, texels, diffuse)),
        lambda: set_scalar_map(document, "rho_s", texels, rho_s, shown="rho_s"),
        lambda: set_scalar_map(document, "alpha", texels, alpha, shown="shininess"),
    )
    notes = [*notes, *brighter]
    if any(microfacets):
        _set_microfacets(document, dense, microfacets)
    set_lights(document, lights, document.image("environment").astype(np.float64), ambient)
    document.set_json(
        "materials",
        {
            "estimator": parameters.estimator,
            "materials": [
                _entry(int(k), m, s, other) | _point(m, parameters.lamp_radius)
                for k, m, s, other in zip(ids, materials, seen[:-1], microfacets, strict=True)
            ],
            "notes": notes,
            "sheen": None if sheen is None else set_sheen(document, sheen, ids),
        },
    )
    return _outcome(parameters.estimator, ids, materials, lights, notes)


def _joint(
    document: Document, labels: np.ndarray, ids: np.ndarray, lights: list[Light],
    diffuse: np.ndarray, parameters: Namespace, progress: Progress,
) -> Estimate:  # fmt: skip
    observations, turn = read_curved_observations(document, rays=parameters.shadows == "rays")
    return estimate(
        observations, labels, lights, diffuse, turn, observations.footprint,
        complete=parameters.complete,
        correct_normals=parameters.normals == "auto", rounds=parameters.rounds,
        samples=parameters.samples, near=parameters.near, long=parameters.long,
        censoring=parameters.censoring, curvature=parameters.curvature, lens=parameters.lens,
        ambient=parameters.ambient, sharp=parameters.sharp,
        microfacets=parameters.reflectance == "auto", ids=ids, progress=progress,
    )  # fmt: skip


def _set_microfacets(
    document: Document, labels: np.ndarray, microfacets: list[Microfacets | None]
) -> None:
    """Maps of what microfacets are, NaN on texels of other materials and of none."""
    of = [(np.nan,) * 3 if m is None else (m.roughness, m.f0, m.strength) for m in microfacets]
    columns = np.array([*of, (np.nan,) * 3], np.float32).T
    roughness, f0, strength = (taken(column, labels) for column in columns)
    texels = document.texels()
    document.set_attribute("material_roughness", roughness)
    document.set_attribute("material_f0", f0)
    document.set_attribute("material_strength", strength / 100)
    set_scalar_map(document, "roughness", texels, roughness, shown="roughness")
    document.set_map("f0", texels.to_images(f0))
    document.set_map("strength", texels.to_images(strength / 100))


def _bell(document: Document, own: np.ndarray, parameters: Namespace) -> Material:
    """The paper's estimate of one material, from its texels (T,) bool."""
    rho_s, alpha = document.attribute("rho_s")[own] * 100, document.attribute("alpha")[own]
    bell = highest_bell(rho_s, alpha, density=parameters.density, bell=parameters.bell)
    count = int(own.sum())
    if bell is None:
        known = int(np.isfinite(alpha).sum())
        return Material(
            np.nan,
            np.nan,
            False,
            f"only {known} of its texels show a peak that tells",
            texels=count,
        )
    return Material(bell.rho_s, bell.alpha, True, texels=count)


def _entry(identity: int, material: Material, seen: np.ndarray, other: Microfacets | None) -> dict:
    entry = {
        "id": identity, "rho_s": seen[0] / 100, "alpha": seen[1],
        "rho_s_lobe": material.rho_s / 100, "alpha_lobe": material.alpha,
        "texels": material.texels, "observed": material.observed, "reason": material.reason,
        "specular_color": material.color, "z": material.z, "ln_alpha_interval": material.width,
        "explained_variance": material.explained,
    }  # fmt: skip
    if other is not None:
        entry["reflectance"] = {
            "model": NAMES[other.kind], "strength": other.strength / 100,
            "roughness": other.roughness, "f0": other.f0, "color": other.color,
            "gain_db": other.gain_db,
        }  # fmt: skip
    return entry


def _point(material: Material, lamp_radius: float) -> dict:
    if lamp_radius == 0:
        return {}
    rho_s, alpha = under_points(material.rho_s, material.alpha, lamp_radius)
    return {"rho_s_point": rho_s / 100, "alpha_point": alpha}


def _outcome(estimator: str, ids, materials: list[Material], lights, notes: list[str]) -> str:
    words = []
    for identity, m in zip(ids, materials, strict=True):
        number = (
            f"rho_s {m.rho_s / 100:.3f}, alpha {m.alpha:.0f}"
            if m.observed
            else f"unobserved: {m.reason}"
        )
        words.append(f"material {identity}: {number}")
    near, long = sum(g.curvature > 0 for g in lights), sum(g.bar.any() for g in lights)
    kinds = f"{near} near" + (f", {long} long" if long else "")
    return "; ".join([f"{estimator}, {len(lights)} lights ({kinds})", *words, *notes])
