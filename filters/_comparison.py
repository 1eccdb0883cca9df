"""Frames beside what the result makes of them: chosen, rendered, judged."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from meshlab_svbrdf.document.coding import Coding
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.freshness import split_labels
from meshlab_svbrdf.document.images import read_mask
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.colors import inferno
from meshlab_svbrdf.rendering.compare import channel_gain, psnr, similarity
from meshlab_svbrdf.rendering.sheet import Panel
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ._lights import read_lights
from ._matte import matte
from .generate_svbrdf_rendering import read_appearance

FEW = 4
"""Frames that are taken where none is held out."""
ERROR_TOP = 32
"""sRGB codes at which the picture of the error is brightest."""
MARGIN = 0.04
"""Around the object, of its size, in pictures."""
WHOLE = 0.999
"""Coverage of a pixel that shows the object alone."""


@dataclass(frozen=True)
class Compared:
    """One frame: figures over the object's pixels, and pictures of one size.

    held_out : whether no stage saw it
    gain : (3,) by which the rendering was multiplied; pixels : how many were judged
    """

    label: str
    held_out: bool
    psnr: float
    ssim: float
    gain: np.ndarray
    pixels: int
    panels: list[Panel] = field(repr=False)

    def row(self) -> dict[str, object]:
        """The figures, for JSON and CSV; infinity is a text."""
        return {
            "label": self.label,
            "held_out": self.held_out,
            "psnr": self.psnr if np.isfinite(self.psnr) else str(self.psnr),
            "ssim": self.ssim,
            "gain": self.gain.tolist(),
            "pixels": self.pixels,
        }


def chosen_frames(document: Document, labels: str, most: int) -> tuple[list[RasterEntry], str]:
    """The frames to compare, and how they were chosen, in words.

    labels : "a; b", or "" for the held-out frames, at most `most`, or else a few of those used
    """
    rasters = {raster.label: raster for raster in document.project.rasters}
    wanted = split_labels(labels)
    for label in wanted:
        if label not in rasters:
            close = difflib.get_close_matches(label, list(rasters), 1)
            first = ", ".join(list(rasters)[:3]) + (", …" if len(rasters) > 3 else "")
            hint = f", did you mean {close[0]!r}?" if close else ""
            hint += f"; there are {len(rasters)}, as in MeshLab's list: {first}"
            raise SvbrdfError(f"frames: there is no raster {label!r}{hint}")
    if wanted:
        return [rasters[label] for label in wanted], "as asked for"
    if held := document.held_out:
        some = _spread(held, most)
        return some, f"held out: {len(some)} of {len(held)}, which no stage has seen"
    used = {frame["label"] for frame in document.json("frames")["frames"] if "samples" in frame}
    own = [raster for raster in document.rasters if raster.label in used]
    some = _spread(own, min(most, FEW))
    if not some:
        raise SvbrdfError("no frame was used for this result that could be compared with it")
    return some, "evenly spaced frames that the result was made from: none is held out"


def compare_frames(
    document: Document, rasters: Sequence[RasterEntry], *, supersampling: int, grey: int,
    gain: str = "auto", phong: bool = False,
) -> Iterator[Compared]:  # fmt: skip
    """Judge and picture one frame after the other.

    grey : sRGB code around the object
    gain : "fit" one per channel to each frame, "none", or "auto": where exposures differed
    """
    mesh, looks, lights = (
        document.mesh(), read_appearance(document, not phong), read_lights(document),
    )  # fmt: skip
    full, diffuse = AcquisitionRenderer(mesh, looks, lights), AcquisitionRenderer(mesh, looks, [])
    clusters = matte(mesh, document.map("materials_shown", "png"))
    told = document.json("frames")
    fit = gain == "fit" or (gain == "auto" and (told["gains_fitted"] or told["exposure"] != "none"))
    frames = Frames(list(rasters), Coding.told(told))
    held = {raster.label for raster in document.held_out}
    back = float(decode(np.array(grey / 255)))
    for raster in rasters:
        camera, frame = raster.camera, frames.read(raster)
        lit, coverage = full.render(camera, supersampling)
        around = back * (1 - coverage[..., None])
        object_ = coverage > 0
        if raster.mask is not None:
            size = (camera.width, camera.height)
            object_ &= read_mask(raster.mask, label=raster.label, size=size)
        on = object_ & (coverage >= WHOLE)
        if not on.any():
            raise SvbrdfError(f"raster {raster.label!r}: the object is not in the picture")

        # Judge what people see: 8-bit sRGB
        times = channel_gain(lit[on], decode(frame[on] / 255)) if fit else np.ones(3)
        rendered = to_srgb8(times * lit + around)
        a, b = rendered / 255, frame / 255
        off = np.abs(rendered.astype(int) - frame).mean(-1) * on

        # Show the parts
        matt, _ = diffuse.render(camera, supersampling)
        gloss = np.maximum(lit - matt, 0)
        top = float(np.quantile(gloss[on].max(-1), 0.999))
        scale = 1 / top if top > 1e-4 else 0.0
        flat, _ = clusters.render(camera, supersampling)
        found = psnr(a[on], b[on]), similarity(a, b, on)
        bar, box = inferno(np.linspace(0, 1, 256)), _around(object_)
        yield Compared(
            raster.label, raster.label in held, *found, times, int(on.sum()),
            [
                Panel(image[box], title, *scales)
                for image, title, *scales in (
                    (to_srgb8(flat + around), "clusters"),
                    (to_srgb8(times * matt + around), "diffuse"),
                    (
                        to_srgb8(gloss * scale + around),
                        f"specular, {scale:.2g} times" if scale else "no specular",
                    ),
                    (rendered, f"rendering, {found[0]:.1f} dB"),
                    (np.where(object_[..., None], frame, np.uint8(grey)), raster.label),
                    (
                        inferno(off / ERROR_TOP),
                        f"error, SSIM {found[1]:.3f}", (bar, "0", str(ERROR_TOP)),
                    ),
                )
            ],
        )  # fmt: skip


def _around(on: np.ndarray) -> tuple[slice, slice]:
    """The part of an image (H, W) bool that holds all that is on, and a margin."""
    rows, cols = (np.flatnonzero(on.any(axis)) for axis in (1, 0))
    margin = max(int(MARGIN * max(np.ptp(rows), np.ptp(cols))), 1)
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(cols[0] - margin, 0), cols[-1] + margin + 1),
    )


def _spread(rasters: Sequence[RasterEntry], most: int) -> list[RasterEntry]:
    """At most so many of them, evenly spaced."""
    count = min(most, len(rasters))
    return [rasters[round((k + 0.5) * len(rasters) / count - 0.5)] for k in range(count)]
