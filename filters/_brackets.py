"""Rasters that show one view with different exposures, and what they tell of the camera."""

from __future__ import annotations

from collections import Counter

import numpy as np

from meshlab_svbrdf.document.coding import Light
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_mask, reduced
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.raster import rasterise_depth
from meshlab_svbrdf.samples.brackets import merge
from meshlab_svbrdf.samples.response import Response, estimate_response

Shots = list[tuple[RasterEntry, float]]
"""The rasters of one view with their exposures; the first stands for the view."""

ALIKE = 1.02  # exposures whose ratio is less are the same
VIEWS = 8  # that a response is measured from, at most
PIXELS = 2000  # of each


def find_brackets(rasters: list[RasterEntry], asked: bool = False) -> list[Shots]:
    """Views of the same sequence and camera with different exposures, the middle one first.

    Exposures are the rasters' own, else the files' (asked : OpenEXR's, too). Views of one
    raster are none, nor are those whose exposures are alike or not told.
    """
    views: dict[tuple, list[RasterEntry]] = {}
    for raster in rasters:
        views.setdefault(_place(raster), []).append(raster)
    found = []
    for own in views.values():
        exposures = _exposures(own, asked) if len(own) > 1 else []
        if not exposures or max(exposures) < ALIKE * min(exposures):
            continue
        shots = sorted(zip(own, exposures, strict=True), key=lambda shot: shot[1])
        middle = shots.pop((len(shots) - 1) // 2)
        found.append([middle, *shots])
    return found


def read_view(frames: Frames, shots: Shots, reduce: int) -> tuple[Light, np.ndarray | None]:
    """A view's light as its first raster exposes it, merged of all, and its mask: what every mask
    shows; None where there is none."""
    lights = [frames.light(raster, reduce) for raster, _ in shots]
    light = lights[0]
    if len(shots) > 1:
        radiances, clipped = zip(*lights, strict=True)
        light = Light(*merge(radiances, clipped, [exposure for _, exposure in shots]))
    masks = [mask for raster, _ in shots if (mask := read_reduced_mask(raster, reduce)) is not None]
    return light, np.logical_and.reduce(masks) if masks else None


def read_reduced_mask(raster: RasterEntry, reduce: int) -> np.ndarray | None:
    """A frame's mask, reduced so that every pixel's whole area is on the object; None for none."""
    if raster.mask is None:
        return None
    size = (raster.camera.width, raster.camera.height)
    mask = read_mask(raster.mask, label=raster.label, size=size)
    return reduced(255 * mask.astype(np.uint8), reduce) == 255


def measure_response(mesh: Mesh, brackets: list[Shots]) -> Response:
    """The response of the camera that took these views, from the object's pixels; SvbrdfError where
    they cannot tell."""
    if not brackets:
        raise SvbrdfError(
            "transfer=estimate: the camera's response cannot be told: no two rasters show the same "
            "view (equal cameras in one sequence) with different exposures (svbrdf_exposure, or "
            "EXIF); say what the transfer function is"
        )
    # Take the views whose exposures most views share
    ratios = [tuple(round(e / shots[0][1], 2) for _, e in shots) for shots in brackets]
    usual = Counter(ratios).most_common(1)[0][0]
    alike = [shots for shots, own in zip(brackets, ratios, strict=True) if own == usual]
    some = [alike[k] for k in np.unique(np.linspace(0, len(alike) - 1, VIEWS).round().astype(int))]
    stacks = []
    for number, shots in enumerate(some):
        with Frames([raster for raster, _ in shots]) as frames:
            if any(frames.told(raster)[1] for raster, _ in shots):
                raise SvbrdfError(
                    "transfer=estimate works on frames of 8 bits: say what the transfer function "
                    "of these is"
                )
            pictures = np.stack([frames.read(raster) for raster, _ in shots])
        on = rasterise_depth(mesh.vertices, mesh.faces, shots[0][0].camera) > 0
        for raster, _ in shots:
            mask = read_reduced_mask(raster, 1)
            on &= True if mask is None else mask
        smooth = np.flatnonzero(on)
        # Leave out edges, where a slight shift would look like a response
        grey = pictures[0].astype(np.float32).mean(-1)
        slope = np.hypot(*np.gradient(grey)).ravel()[smooth]
        smooth = smooth[slope <= np.quantile(slope, 0.7)] if len(smooth) else smooth
        rng = np.random.default_rng(number)
        chosen = rng.choice(smooth, min(PIXELS, len(smooth)), replace=False)
        stacks.append(pictures.reshape(len(shots), -1, 3)[:, chosen])
    return estimate_response(stacks, [exposure for _, exposure in some[0]])


def _place(raster: RasterEntry) -> tuple:
    """What rasters of one view share: sequence and camera, within rounding."""
    camera = raster.camera
    far = max(float(np.abs(camera.t).max()), 1e-9)
    intrinsics = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
    return (
        raster.sequence, *np.round(intrinsics, 3), *np.round(camera.R, 6).ravel(),
        *np.round(camera.t / far, 6), float(f"{far:.6g}"),
    )  # fmt: skip


def _exposures(rasters: list[RasterEntry], asked: bool) -> list[float]:
    """Of each, all from one source; empty where they are not told."""
    values = [raster.exposure for raster in rasters]
    if None in values:
        frames = Frames(rasters)
        try:
            values = [frames.exposure(raster, asked=asked) for raster in rasters]
        except DocumentError:
            return []  # the filter says which file cannot be read
    return [value for value in values if value is not None] if None not in values else []
