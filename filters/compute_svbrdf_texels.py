"""Texels: the places on the surface that everything is measured at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, texture_files
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.normal_maps import apply_normal_map
from meshlab_svbrdf.geometry.parametrise import parametrise
from meshlab_svbrdf.geometry.texels import Texels, rasterise_texels
from meshlab_svbrdf.geometry.udim import split_tiles
from meshlab_svbrdf.geometry.uv_checks import check_uv
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.threads import side_by_side

OVERLAP_MOST = 0.05
MOST_TEXTURES = 256  # a byte tells a texel's

FILTER = Filter(
    name="compute_svbrdf_texels",
    title="SVBRDF: texels",
    needs=("mesh",),
    writes=("texels",),
    parameters=(
        Parameter(
            "texture_size", "int", 1024, minimum=16, maximum=16384, unit="pixels",
            help="Side of the texture images. Texels finer than the frames' pixels only cost time.",
        ),
        Parameter(
            "parametrise", "enum", "auto", choices=("auto", "always", "never"),
            help="Whether to cut the surface into new charts (xatlas): where the mesh has no "
            "texture coordinates, always (for torn or overlapping ones), or never.",
        ),
        Parameter(
            "normal_map", "path", "",
            help="Image of the surface's detail, for the first texture; further textures' images "
            "are NAME.1.png, NAME.2.png … beside it, or of UDIM tiles NAME.1001.png, "
            "NAME.1002.png …, one of which is given. Empty: the mesh's own normals.",
        ),
        Parameter(
            "normal_space", "enum", "tangent", choices=("tangent", "object"),
            help="What the normal map is relative to: the charts, or the mesh's own coordinates, "
            "before its layer's matrix.",
        ),
        Parameter(
            "green", "enum", "up", choices=("up", "down"),
            help='Which way green points in a tangent-space map: "up" as OpenGL, "down" as '
            "DirectX.",
        ),
        Parameter(
            "allow_overlap", "bool", False,
            help="Go on although charts overlap; where they do, the first face gets the texel.",
        ),
    ),
    help="Rasterises the object's UV charts: one texel per pixel centre inside a triangle, with "
    "its position, normal, face and barycentric coordinates. A mesh without texture coordinates "
    "is parametrised first (xatlas). Coordinates in UDIM tiles give a texture for each tile, and "
    "maps NAME.1001.png, NAME.1002.png … Overlapping, out-of-range and torn charts are told.",
    reference="Palma et al. 2012, §3",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    said = []
    mesh = document.mesh()
    if len(mesh.faces) == 0:
        raise SvbrdfError(f"layer {document.object_layer().label!r} has no faces")
    size = parameters.texture_size
    if mesh.uv is None and parameters.parametrise == "never":
        raise SvbrdfError(
            f"layer {document.object_layer().label!r} has no texture coordinates: parametrise it "
            "in MeshLab, or pass parametrise=auto"
        )
    if mesh.uv is None or parameters.parametrise == "always":
        progress(0.1, "cutting the surface into charts")
        reason = "for the mesh has no texture coordinates" if mesh.uv is None else "as asked"
        mesh = parametrise(mesh, size)
        assert mesh.uv is not None
        document.set_uv(mesh.uv)
        said.append(f"parametrised, {reason}")
    tiles: list[int] = []
    if split := split_tiles(mesh):
        mesh, numbers = split
        assert mesh.uv is not None
        document.set_uv(mesh.uv, mesh.texture_index)
        if len(np.unique(numbers)) == len(numbers):
            tiles = numbers.tolist()
            document.set_array("tiles", numbers)
        said.append(f"UDIM tiles {_ranges(numbers)}")
    count = 1 if mesh.texture_index is None else max(1, int(mesh.texture_index.max()) + 1)
    if count > MOST_TEXTURES:
        raise SvbrdfError(
            f"the texture coordinates lie in {count} textures, at most {MOST_TEXTURES} are "
            "possible: pass parametrise=always for new ones in a single texture"
        )
    sizes = ((size, size),) * count

    progress(0.3, "rasterising the charts")
    texels: Texels
    odd, texels = side_by_side(
        lambda: _check_charts(mesh, sizes, parameters.allow_overlap),
        lambda: rasterise_texels(mesh, sizes),
    )
    said += odd
    if len(texels) == 0:
        raise SvbrdfError(
            "no texel lies inside a chart: the texture coordinates are empty or out of range"
        )
    if parameters.normal_map:
        maps = [read_image(name) for name in texture_files(parameters.normal_map, count, tiles)]
        normals, valid = apply_normal_map(
            texels, mesh, maps,
            parameters.normal_space, parameters.green, document.object_layer().matrix,
        )  # fmt: skip
        texels = replace(texels, normal=normals.astype(np.float32))
        document.set_array("texels_detail", valid)
        said.append(f"normals of {parameters.normal_map.name}")
        if not valid.all():
            said.append(f"{int((~valid).sum())} texels without a tangent frame keep the mesh's")
    document.set_texels(texels)
    images = "" if count == 1 else f" in {count} images"
    return "; ".join([f"{len(texels):,} texels at {size}×{size}{images}", *said])


def _ranges(numbers: np.ndarray) -> str:
    """Ascending numbers in words: 1001-1003, 1011."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{r[0]}-{r[-1]}" if r[0] < r[-1] else str(r[0]) for r in runs)


def _check_charts(mesh: Mesh, sizes, allow_overlap: bool) -> list[str]:
    """What is odd about the texture coordinates; SvbrdfError where it would spoil the result."""
    report = check_uv(mesh, sizes)
    if report.overlap_share > OVERLAP_MOST and not allow_overlap:
        raise SvbrdfError(
            f"{report.overlap_share:.0%} of the texels belong to several places of the surface "
            "(overlapping charts): pass parametrise=always for new ones, or allow_overlap=true"
        )
    return [] if report.ok else [report.message]
