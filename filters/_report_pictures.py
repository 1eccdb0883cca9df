"""The report's pictures: the object from four sides, its maps, frames beside renderings."""

from __future__ import annotations

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.reflectance.labels import palette
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.colors import scale_of, viridis
from meshlab_svbrdf.rendering.paths import framed, turntable, upward
from meshlab_svbrdf.rendering.surface import SurfaceRenderer
from meshlab_svbrdf.reporting.html import (
    Html,
    css,
    figure,
    join,
    note,
    picture,
    section,
    table,
    tag,
)
from meshlab_svbrdf.reporting.plots import chart, color_bar, histogram
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ._comparison import chosen_frames, compare_frames
from ._lights import read_lights
from ._maps import LOGARITHMIC
from ._matte import matte
from .generate_svbrdf_rendering import read_appearance

SIDES = 4
SIDE = 560
"""Pixels of a picture of the object, before it is cut."""
MAP = 380
"""Of a map."""
GREY = 245
COMPARED = 3
"""Frames that are compared."""
SHADES = 64
"""Of a scale of colours."""
COLORS = ("#c0453b", "#3f8f4f", "#3a6ea5")
MAPS = {  # file: title, its PNG, whether its histogram is logarithmic, unit
    "diffuse": ("Diffuse colour", "diffuse", False, "linear, 1 = white"),
    "albedo": ("Albedo", "albedo", False, "linear, of a lamp of gain 1"),
    "rho_s": ("Strength of the highlight ρs", "rho_s", True, "1 = white"),
    "alpha": ("Shininess α", "alpha", True, "exponent"),
    "roughness": ("Roughness of microfacets", "roughness", True, "a of GGX or Beckmann"),
    "sheen": ("Sheen", "sheen", False, "strength"),
}


def missing(document: Document, product: str, maker: str) -> Html | None:
    """What is said in place of a stage that did not run."""
    if document.has(product):
        return None
    return note(f"Not made: {maker} has not run on this project.", "missing")


def object_views(document: Document) -> Html:
    """The object from four sides as it was lit, and from one in each of its maps."""
    title = "The object"
    said = missing(document, "diffuse", "compute_svbrdf_diffuse_color")
    if said is not None:
        return section(title, said)
    mesh = document.mesh()
    cameras = sides(document)
    lit = _as_lit(document, mesh)
    if document.has("material_specular"):
        words = "As it was lit when it was filmed: diffuse colour and highlights, rendered."
    else:
        words = "Its diffuse colour; highlights were not estimated."
    turned = [picture(shown(lit, camera), side_name(k)) for k, camera in enumerate(cameras)]
    parts = []
    for name, caption in (
        ("diffuse", "diffuse colour"), ("albedo", "albedo"), ("materials_shown", "materials"),
        ("rho_s", "strength ρs"), ("alpha", "shininess α"), ("roughness", "roughness"),
    ):  # fmt: skip
        if document.map_paths(name, "png"):
            worn = matte(mesh, [image[..., :3] for image in document.map(name, "png")])
            parts.append(picture(shown(worn, cameras[0]), caption))
    return section(
        title, note(words), tag("div", *turned, class_="strip"),
        note("The first view in its maps (in colour scales, whose numbers are at the "
            "maps below, bright is much; grey is unobserved)."),
        tag("div", *parts, class_="strip"),
    )  # fmt: skip


def portrait(document: Document, most: int) -> np.ndarray:
    """The first of these views in at most so many columns and rows, (H, W, 3) uint8."""
    camera = sides(document)[0]
    camera = camera.scaled(most / max(camera.width, camera.height))
    return shown(_as_lit(document, document.mesh()), camera)


def _as_lit(document: Document, mesh: Mesh) -> SurfaceRenderer:
    """The object with its highlights, or in its diffuse colour where these are not known."""
    if document.has("material_specular"):
        return AcquisitionRenderer(mesh, read_appearance(document), read_lights(document))
    return matte(mesh, document.map("diffuse"))


def maps(document: Document) -> Html:
    """Every map as it lies in the texture, with its histogram."""
    parts = []
    for name, (title, image, log, unit) in MAPS.items():
        if not document.map_paths(name):
            continue
        pixels = np.concatenate([m.reshape(-1, *m.shape[2:]) for m in document.map(name)])
        bar = _bar(pixels, unit, name in LOGARITHMIC) if pixels.ndim == 1 else Html()
        parts.append(_map(document, title, image, pixels, log, unit, bar))
    if document.map_paths("material", "png"):
        parts.append(_labels(document))
    if not parts:
        return section("Maps", note("Not made: no filter has written a map.", "missing"))
    return section(
        "Maps",
        note(
            "As they lie in the texture. Histograms leave out what is unobserved; values beyond "
            "their ends count there. Colours run from the first percent of the values to the last."
        ),
        *parts,
    )


def comparison(document: Document) -> Html:
    """Frames beside renderings; why there are none, where that is so."""
    title = "Compared with frames"
    said = missing(document, "material_specular", "compute_svbrdf_material_specular")
    if said is not None:
        return section(title, said)
    try:
        rasters, how = chosen_frames(document, "", COMPARED)
        found = list(compare_frames(document, rasters, supersampling=2, grey=GREY))
    except SvbrdfError as error:
        return section(title, note(f"Not made: {error}", "missing"))
    rows = [
        (c.label, "held out" if c.held_out else "used", f"{c.psnr:.1f}", f"{c.ssim:.3f}")
        for c in found
    ]
    strips = []
    for compared in found:
        panels = [picture(panel.image, panel.title, 400) for panel in compared.panels]
        strips += [tag("h3", compared.label), tag("div", *panels, class_="strip")]
    top = compared.panels[-1].scale
    ends = f"0 (black) to {top[2]} (bright) of 255" if top else ""
    return section(
        title,
        note(f"Frames: {how}. PSNR and SSIM in sRGB over the object's pixels; errors {ends}."),
        table(("frame", "", "PSNR, dB", "SSIM"), rows),
        *strips,
    )


def _map(
    document: Document, title: str, image: str, pixels: np.ndarray, log: bool, unit: str,
    bar: Html,
) -> Html:  # fmt: skip
    pixels = pixels.reshape(len(pixels), int(np.prod(pixels.shape[1:])))
    values = pixels[np.isfinite(pixels).all(1)]
    images = [
        picture(each[..., :3], f"{title}{f', texture {k}' if k else ''}", MAP)
        for k, each in enumerate(document.map(image, "png"))
    ]
    if not len(values):
        return join([tag("h3", title), note("Unobserved everywhere.", "missing")])
    channels = COLORS if values.shape[1] == 3 else ("#3a6ea5",)
    bars = [
        histogram(own, color, log=log) for own, color in zip(values.T, channels, strict=True)
    ]  # fmt: skip
    drawn = chart([each for each in bars if each], f"{title}, {unit}", "% of texels", log)
    middle = " · ".join(f"{m:.3g}" for m in np.median(values, axis=0))
    ends = f"{values.min():.3g} to {values.max():.3g}"
    caption = f"{len(values):,} texels; median {middle}; {ends}"
    worn = tag("div", *images, bar)
    return join([tag("h3", title), tag("div", worn, figure(drawn, caption), class_="grid")])


def _bar(values: np.ndarray, unit: str, log: bool) -> Html:
    """What the colours of a map of values (n,) mean."""
    return color_bar(viridis(np.linspace(0, 1, SHADES)), *scale_of(values, log), unit)


def _labels(document: Document) -> Html:
    """The clusters: how much of the surface each has."""
    labels = document.attribute("material")
    used, counts = np.unique(labels[labels >= 0], return_counts=True)
    colors = palette(len(used))
    rows = [
        (join([swatch(color), str(k)]), f"{n:,}", f"{100 * n / len(labels):.1f} %")
        for k, n, color in zip(used, counts, colors, strict=True)
    ]
    images = [picture(i[..., :3], "Materials", MAP) for i in document.map("materials_shown", "png")]
    counted = table(("material", "texels", "of all"), rows)
    return join([tag("h3", "Materials"), tag("div", *images, counted, class_="grid")])


def swatch(color: np.ndarray) -> Html:
    """A small square of a colour (3,) uint8."""
    return tag("span", class_="swatch", style=f"background:{css(color)}")


def side_name(k: int) -> str:
    """What the k-th of `sides` is called."""
    return f"{360 * k // SIDES}°"


def sides(document: Document) -> list[Camera]:
    """Cameras at four sides, upright as those of the film were held."""
    mesh, held = document.mesh(), [raster.camera for raster in document.project.rasters]
    R = np.diag([1.0, -1.0, -1.0])
    first = held[0] if held else Camera(1, 1, 1, 1, 0, 0, R, -R @ (mesh.center - R[2]))
    up = upward(held) if held else np.array([0, 1.0, 0])
    focal, middle = 2.0 * SIDE, (SIDE - 1) / 2
    lens = Camera(SIDE, SIDE, focal, focal, middle, middle, first.R, first.t)
    return framed(turntable(lens, mesh.center, mesh.radius, up, SIDES), mesh.vertices)


def shown(renderer: SurfaceRenderer, camera: Camera) -> np.ndarray:
    """A view on nearly white, (H, W, 3) uint8."""
    image, coverage = renderer.render(camera, 2)
    return to_srgb8(image + decode(np.array(GREY / 255)) * (1 - coverage[..., None]))
