"""The object for other programs: glTF, OBJ, textures by their usual names, lamps."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.atomic import filling
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.freshness import in_words
from meshlab_svbrdf.document.light_files import read_light_file
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.exporting.lights import found_lights
from meshlab_svbrdf.exporting.maps import LEVEL, made_of
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.rendering.environment_lights import Illumination
from meshlab_svbrdf.rendering.surface import Appearance

from ._export import FORMATS, Package, normal_maps, write_account, write_format
from ._lights import read_lights
from .generate_svbrdf_relighting import lamps_of
from .generate_svbrdf_rendering import read_appearance

FILTER = Filter(
    name="generate_svbrdf_export",
    title="SVBRDF: export for other programs",
    needs=("mesh", "texels", "material_specular"),
    needs_if={"albedo": ("color", "albedo")},
    parameters=(
        Parameter("folder", "path", "", help="Where the files go, NAME of the project in front."),
        Parameter(
            "formats", "string", "glb obj textures lights",
            help="Of gltf, glb, obj, textures and lights; NAME.json is always written.",
        ),
        Parameter(
            "color", "enum", "auto", choices=("auto", "albedo", "diffuse"),
            help='"albedo" is lit anew; "diffuse" has the light and shadow in which it was filmed, '
            "and is shown unlit; auto: the albedo where it is there.",
        ),
        Parameter(
            "lights", "path", "",
            help="A JSON file of lights in the form of lights.json; empty: those found.",
        ),
        Parameter(
            "scale", "float", 1.0, minimum=1e-6, maximum=1e6,
            help="Colour and gloss are times this, lamps divided by it; no frame tells "
            "it: make it less where colours are brighter than 1, and cut.",
        ),
        Parameter(
            "unobserved", "enum", "grey", choices=("grey", "nearest"),
            help="Colour of texels that were not observed: a grey, or their nearest neighbour's. "
            "The image Observed marks them.",
        ),
        Parameter(
            "color_images", "enum", "png", choices=("png", "jpeg"),
            help="How glTF's base colour is stored; all else is PNG.",
        ),
    ),
    help="Writes what other programs open: glTF 2.0 (or GLB) with normal map, roughness, "
    "KHR_materials_specular and the lamps; OBJ with Kd, Ks, Ns; textures for Blender, Substance "
    "and Unreal; lamps as a map of directions. Lobes become GGX of the same energy and top.",
    reference="Khronos, glTF 2.0; Walter et al. 2007 (GGX)",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    formats = _formats(parameters.formats)
    if parameters.folder is None:
        raise SvbrdfError("folder is empty: say where the files go")
    light, ambient = _light(document, parameters.lights)
    light = replace(light, color=light.color / parameters.scale)

    # Gather what the object is made of
    progress(0.0, "materials")
    shaded = _shaded(document, parameters.color)
    fill = parameters.unobserved == "nearest"
    made = [made_of(look, parameters.scale, fill) for look in _looks(document, True, shaded)]
    mesh, texels = document.mesh(), document.texels()
    progress(0.2, "normals")
    tangents, normals = normal_maps(document, mesh, texels)
    package = Package(
        document.name, mesh, texels.radius, made, tangents, normals, light,
        ambient / parameters.scale, shaded, parameters.color_images == "jpeg", document.tiles(),
    )  # fmt: skip

    # Write every format, all of them or nothing
    files: dict[str, str] = {}
    with filling(Path(parameters.folder)) as folder:
        for name in progress.over(formats, "writing"):
            phong = [] if name != "obj" else _looks(document, False, shaded)
            files |= write_format(name, folder, package, phong, parameters.scale, document)
        coverage = _coverage(package)
        write_account(folder, document, package, files, coverage, vars(parameters))
    return "; ".join([f"{len(files) + 1} files in {parameters.folder}", *_told(package, coverage)])


def _formats(text: str) -> list[str]:
    words = list(dict.fromkeys(re.findall(r"[^\s,;]+", text)))
    unknown = [word for word in words if word not in FORMATS]
    if unknown or not words:
        what = f"there is no format {unknown[0]!r}" if unknown else "no format is given"
        raise SvbrdfError(f"{what}: choose of {', '.join(FORMATS)}")
    return words


def _shaded(document: Document, color: str) -> bool:
    """Whether the colour is the diffuse one, with its light; SvbrdfError for an albedo of old."""
    if color == "auto" and document.has("albedo"):
        older = document.stale("albedo")
        if older:
            raise SvbrdfError(
                f"the albedo is older than the {in_words(older)}: run compute_svbrdf_albedo again, "
                "or give color=diffuse"
            )
        return False
    return color != "albedo"


def _looks(document: Document, microfacets: bool, shaded: bool) -> list[Appearance]:
    looks = read_appearance(document, microfacets)
    if shaded:
        return looks
    return [
        replace(look, diffuse=own) for look, own in zip(looks, document.map("albedo"), strict=True)
    ]


def _light(document: Document, path: Path | None) -> tuple[Illumination, np.ndarray]:
    if path is not None:
        told = read_light_file(path)
        return lamps_of(document, told.lamps), told.ambient
    radius, ambient = float(document.array("texels_radius")), document.json("lights")["ambient"]
    return (
        found_lights(read_lights(document), radius),
        np.zeros(3) if ambient is None else np.array(ambient, float),
    )


def _coverage(package: Package) -> dict[str, float]:
    """Shares of the texels."""
    inside = sum(int(made.inside.sum()) for made in package.made)

    def share(marks) -> float:
        return sum(int(mark.sum()) for mark in marks) / max(inside, 1)

    with np.errstate(invalid="ignore"):
        return {
            "texels": inside,
            "color_unobserved": share(m.inside & ~m.known for m in package.made),
            "gloss_unobserved": share(m.inside & ~m.glossy for m in package.made),
            "color_cut_at_1": share(m.known & (m.color > 1).any(-1) for m in package.made),
            "specular_level_cut_at_1": share(
                m.inside & (m.ggx.facing > LEVEL) for m in package.made
            ),
            "mirrored_share_cut_at_1": share(m.inside & (m.ggx.facing > 1) for m in package.made),
        }


def _told(package: Package, coverage: dict[str, float]) -> list[str]:
    """What a user has to know, in words."""
    lines = []
    if package.shaded:
        lines.append("the colour is the diffuse one with its light and shadow, unlit")
    for key, words in (
        ("color_unobserved", "of the texels have no observed colour"),
        ("gloss_unobserved", "have no observed gloss, and show none"),
        ("color_cut_at_1", "are brighter than 1 and cut: a smaller `scale` keeps them"),
        ("mirrored_share_cut_at_1", "would mirror more than all light: a smaller `scale` is right"),
    ):
        if coverage[key] >= 0.0005:
            lines.append(f"{100 * coverage[key]:.1f} % {words}")
    return lines
