"""Which of a project's frames are sampled, and in what order."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.space import free_bytes, in_words, memory_bytes_free
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.planning.cost import store_bytes
from meshlab_svbrdf.planning.resolution import resolution
from meshlab_svbrdf.samples.capture import (
    CLIPPED,
    CLIPPED_MEAN,
    FrameSampler,
    Quality,
    reference_depth,
)
from meshlab_svbrdf.samples.choose_frames import choose_frames, run_order

from ._brackets import Shots, find_brackets, read_reduced_mask

FEWEST = 8  # frames of a sequence that no spacing goes below: fewer samples observe no texel
TRIED = 8  # frames whose texels are counted, to know what all will need


@dataclass(frozen=True)
class Choice:
    """rasters : to use, sequence by sequence, in the project's order
    sequences : all of the project's
    order : by label, a frame's place for runs of peaks
    left_out : by label, why
    said : what the outcome says of it, or ""
    brackets : by label of the first, the rasters that are merged to it, and their exposures
    """

    rasters: list[RasterEntry]
    sequences: list[str]
    order: dict[str, int]
    left_out: dict[str, str]
    said: str
    brackets: dict[str, Shots]


def choose(document: Document, parameters: Namespace, mesh: Mesh) -> Choice:
    """The frames that compute_svbrdf_samples uses with these parameters: by geometry alone."""
    sequences = list(dict.fromkeys(r.sequence for r in document.project.rasters))

    # Take each view once
    found: list[Shots] = []
    if parameters.brackets == "auto":
        found = find_brackets(document.project.rasters, parameters.exposure == "exif")
    held_out = {raster.label for raster in document.held_out}
    merged = {r.label: f"merged to {shots[0][0].label}" for shots in found for r, _ in shots[1:]}
    for shots in found:
        labels = {raster.label for raster, _ in shots}
        if labels & held_out:
            merged |= dict.fromkeys(labels - held_out, "another exposure of its view is held out")
    brackets = {shots[0][0].label: shots for shots in found}

    places: dict[str, int] = {}
    seen_so_far = dict.fromkeys(sequences, 0)
    for raster in document.project.rasters:
        places[raster.label] = seen_so_far[raster.sequence]
        seen_so_far[raster.sequence] += raster.label not in merged
    views = [raster for raster in document.rasters if raster.label not in merged]
    rasters = sorted(views, key=lambda r: sequences.index(r.sequence))

    # Use every n-th
    nth = parameters.step
    if parameters.spacing > 0:
        steps = _steps([r.camera for r in rasters], [r.sequence for r in rasters], mesh.center)
        # Where a film mostly stands still, the median step is not how far it goes when it goes
        apart = max(np.median(steps), 0.5 * np.quantile(steps, 0.9)) if len(steps) else 0.0
        n = max(1, int(parameters.spacing / (nth * apart) + 1e-6)) if apart > 0 else 1
        nth *= min(n, max(1, max(seen_so_far.values()) // (nth * FEWEST)))
    left_out = {r.label: f"one frame in {nth} is used" for r in rasters if places[r.label] % nth}
    order = {label: place // nth for label, place in places.items()}
    said = f", one in {nth}" if nth > 1 else ""
    rasters = [r for r in rasters if r.label not in left_out]

    # Of these, use as many as are allowed
    kept = choose_frames([r.camera for r in rasters], mesh.center, mesh.radius, parameters.frames)
    if len(kept) < len(rasters):
        why = f"at most {parameters.frames} frames are used, spread evenly"
        left_out |= {rasters[k].label: why for k in set(range(len(rasters))) - set(kept.tolist())}
        rasters = [rasters[k] for k in kept]
        for sequence in sequences:
            own = [r.label for r in rasters if r.sequence == sequence]
            order |= zip(own, run_order([order[label] for label in own]).tolist(), strict=True)
        said += ", spread evenly"
    said += f": {len(left_out)} are left out" if said else ""
    used = {raster.label for raster in rasters}
    brackets = {label: shots for label, shots in brackets.items() if label in used}
    left_out |= {label: why for label, why in merged.items() if label not in held_out}
    return Choice(rasters, sequences, order, left_out, said, brackets)


def reduction(parameters: Namespace, mesh: Mesh, side: int, cameras: list[Camera]) -> int:
    """By how much frames are reduced before they are sampled at textures of that side."""
    if parameters.reduce != "auto":
        return int(parameters.reduce)
    return resolution(mesh, cameras).reduction(side)


def read_reduced(
    frames: Frames, raster: RasterEntry, reduce: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """A frame and its mask (None where it has none), reduced; every pixel's whole area is masked.

    Raises DocumentError where they cannot be read.
    """
    return frames.read(raster, reduce), read_reduced_mask(raster, reduce)


def frame_sampler(
    mesh: Mesh, texels: Texels, cameras: list[Camera], parameters: Namespace, reduce: int
) -> FrameSampler:
    """What projects the frames, reduced, with these parameters.

    The depth from which on quality falls is taken in steps of a quarter octave of the radius: a few
    more frames leave the samples of the others as they are.
    """
    points = max(50, min(2000, 1_000_000 // len(cameras)))
    some = mesh.vertices[:: max(1, len(mesh.vertices) // points)]
    quality = Quality(
        parameters.border, 0.05, parameters.occlusion, max(parameters.minimum_quality, 1 / 127),
        CLIPPED if reduce == 1 else CLIPPED_MEAN,
    )  # fmt: skip
    radii = reference_depth(some, cameras) / mesh.radius
    depth = float(2 ** (np.rint(4 * np.log2(radii)) / 4) * mesh.radius)
    return FrameSampler(mesh, texels, depth, quality)


def check_space(
    folder: Path | None, sampler: FrameSampler, cameras: list[Camera], memory: int, bits: int = 8
) -> None:
    """Refuse, before anything is made, what the disk of `folder` (None: memory) cannot hold.

    memory : bytes of samples that are held before a chunk is written
    bits : of a sample's values
    """
    texels, frames = len(sampler.texels), len(cameras)
    free = memory_bytes_free() if folder is None else free_bytes(folder)
    if store_bytes(texels * frames, texels, frames, memory, bits) <= free:
        return  # though every frame saw every texel
    some = choose_frames(cameras, sampler.texels.center, sampler.texels.radius, TRIED)
    seen = 0
    for camera in [cameras[k] for k in some]:
        blank = np.zeros((camera.height, camera.width, 3), np.uint8)
        seen += len(sampler.sample(camera, blank)[0])
    needed = store_bytes(seen / max(len(some), 1) * frames, texels, frames, memory, bits)
    if needed > free:
        what = f"the samples of {frames} frames at {texels:,} texels need about {in_words(needed)}"
        fewer = (
            "use fewer frames (--set compute_svbrdf_samples.frames=120), a smaller texture "
            "(--texture-size), or "
        )
        if folder is None:
            raise SvbrdfError(
                f"{what} of memory, and {in_words(free)} are free: {fewer}keep them on disk "
                "(--set compute_svbrdf_samples.store=disk)"
            )
        raise SvbrdfError(
            f"{what} on disk, and {in_words(free)} are free in {folder.parent}: {fewer}another "
            "place (-o)"
        )


def median_step(cameras: list[Camera], sequences: list[str], center: np.ndarray) -> float:
    """Degrees between a frame's view of the centre and the next one's, the median."""
    steps = _steps(cameras, sequences, center)
    return float(np.median(steps)) if len(steps) else 0.0


def _steps(cameras: list[Camera], sequences: list[str], center: np.ndarray) -> np.ndarray:
    """Degrees between neighbours of each sequence, as seen from the centre."""
    views = np.array([c.center - center for c in cameras])
    views /= np.maximum(np.linalg.norm(views, axis=1, keepdims=True), 1e-30)
    same = np.array([a == b for a, b in pairwise(sequences)], bool)
    cos = np.einsum("ij,ij->i", views[:-1], views[1:])[same]
    return np.degrees(np.arccos(np.clip(cos, -1, 1)))
