"""Projecting the frames to the texels, once."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_mask
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.samples.capture import FrameSampler, Quality, reference_depth
from meshlab_svbrdf.samples.gains import frame_gains, gain_spread
from meshlab_svbrdf.samples.observations import observe
from meshlab_svbrdf.samples.store import write_store

from ._stages import counted, share

VARYING = 0.03  # robust spread of ln gain; a locked exposure leaves .003
STILLS = 5.0  # degrees between neighbouring cameras from which frames are no video

FILTER = Filter(
    name="compute_svbrdf_samples",
    title="SVBRDF: samples",
    needs=("mesh", "rasters", "texels"),
    writes=("samples",),
    parameters=(
        Parameter(
            "exposure", "enum", "auto", choices=("auto", "exif", "raster", "none"),
            help="Divides frames by their exposure: the attribute svbrdf_exposure of each raster "
            '("raster"), ExposureTime · ISO / FNumber² of each photograph ("exif"), the first of '
            'the two that every frame has ("auto"), or "none".',
        ),
        Parameter(
            "gains", "enum", "auto", choices=("auto", "fit", "none"),
            help="Divides frames by a gain per channel, fitted from the texels that they share. "
            '"auto" does so where their brightness or white balance varies by more than 3 %, and '
            "says it.",
        ),
        Parameter(
            "unreadable", "enum", "stop", choices=("stop", "skip"),
            help="What to do about frames that are missing or cannot be read: they are named.",
        ),
        Parameter(
            "step", "int", 1, minimum=1, maximum=1000,
            help="Use every n-th frame of a sequence.",
        ),
        Parameter(
            "spacing", "float", 0.0, minimum=0.0, maximum=90.0, unit="degrees",
            help="Use every n-th frame of a sequence, n as large as keeps neighbours within this "
            "angle of each other; stills that are farther apart are all used. 0: all frames.",
        ),
        Parameter(
            "minimum_quality", "float", 0.1, minimum=0.0, maximum=1.0,
            help="Samples below are dropped. 0 keeps all: only the threshold's own limit counts "
            "then, as the paper has it.",
        ),
        Parameter(
            "border", "float", 5.0, minimum=0.5, maximum=50.0, unit="pixels at 640 wide",
            help="Over what distance quality rises from depth jumps, image borders and mask edges. "
            "Raise it where the registration is poor.",
        ),
        Parameter(
            "occlusion", "float", 0.02, minimum=0.0001, maximum=0.5, unit="object radii",
            help="How much deeper than the depth map a texel may lie and still count as seen.",
        ),
        Parameter(
            "memory", "int", 256, minimum=16, maximum=65536, unit="MiB",
            help="Of samples held before a chunk is written.",
        ),
    ),
    help="Projects every frame to the texels: depth test, quality (distance to depth jumps, "
    "nearness, angle), colour interpolated in linear light. Frames are streamed, one after the "
    "other; the samples go to the sample store, 5 bytes each.",
    reference="Palma et al. 2012, §4; Callieri et al. 2008",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    # Order the frames: sequence by sequence, in the project's order
    sequences = list(dict.fromkeys(r.sequence for r in document.project.rasters))
    places: dict[str, int] = {}
    seen_so_far = dict.fromkeys(sequences, 0)
    for raster in document.project.rasters:
        places[raster.label] = seen_so_far[raster.sequence]
        seen_so_far[raster.sequence] += 1
    rasters = sorted(document.rasters, key=lambda r: sequences.index(r.sequence))
    nth = parameters.step
    if parameters.spacing > 0:
        apart = _median_step(
            [r.camera for r in rasters], [r.sequence for r in rasters], document.mesh().center
        )
        nth *= max(1, int(parameters.spacing / (nth * apart) + 1e-6)) if apart > 0 else 1
    left_out = {r.label: f"one frame in {nth} is used" for r in rasters if places[r.label] % nth}
    thinned = len(left_out)
    rasters, unreadable = _readable(
        [r for r in rasters if r.label not in left_out], parameters.unreadable
    )
    left_out |= unreadable
    if not rasters:
        raise SvbrdfError("no frame is left to sample")

    # Project them
    mesh, texels = document.mesh(), document.texels()
    cameras = [raster.camera for raster in rasters]
    points = max(50, min(2000, 1_000_000 // len(cameras)))
    some = mesh.vertices[:: max(1, len(mesh.vertices) // points)]
    quality = Quality(
        parameters.border, 0.05, parameters.occlusion, max(parameters.minimum_quality, 1 / 127)
    )
    sampler = FrameSampler(mesh, texels, reference_depth(some, cameras), quality)

    quality_sum = np.zeros(len(rasters))

    def sample(index: int):
        raster = rasters[index]
        size = (raster.camera.width, raster.camera.height)
        image = frames.read(raster)
        mask = (
            None if raster.mask is None else read_mask(raster.mask, label=raster.label, size=size)
        )
        samples = sampler.sample(raster.camera, image, mask)
        quality_sum[index] = (samples[2] & 127).sum() / 127
        return samples

    with Frames(rasters) as frames:
        store = write_store(
            document.staged_folder("samples"), len(texels), len(rasters), sample,
            memory=parameters.memory << 20, progress=counted(progress.part(0, 0.9), "frames"),
        )  # fmt: skip
    if len(store) == 0:
        raise SvbrdfError(
            "no texel is seen in any frame: check that the rasters are aligned to this mesh "
            "(in MeshLab, show a raster and look whether the mesh covers the object)"
        )

    # Bring the frames to one exposure
    exposure, source = _exposures(rasters, parameters.exposure)
    progress(0.92, "comparing the frames' brightness")
    observations = observe(texels, store, cameras, mesh.faces, gains=exposure)
    fitted, residual = frame_gains(observations)
    spread = gain_spread(fitted)
    use = parameters.gains == "fit" or (parameters.gains == "auto" and spread > VARYING)
    gain = exposure[:, None] * (np.where(np.isfinite(fitted), fitted, 1.0) if use else 1.0)
    gain = np.broadcast_to(gain / np.median(gain), (len(rasters), 3))
    step = _median_step(cameras, [r.sequence for r in rasters], texels.center)

    document.set_array("samples_gain", gain)
    document.set_array(
        "samples_sequence", np.array([sequences.index(r.sequence) for r in rasters], np.int32)
    )
    document.set_array(
        "samples_order", np.array([places[r.label] // nth for r in rasters], np.int32)
    )
    document.set_json(
        "frames",
        {
            "exposure": source,
            "gains_fitted": use,
            "gain_spread": spread,
            "median_step_degrees": step,
            "stills": bool(step > STILLS),
            "frames": [
                {
                    "label": raster.label, "sequence": raster.sequence, "gain": gain[k],
                    "samples": int(store.seen[k]), "residual": residual[k],
                    "quality": quality_sum[k] / max(store.seen[k], 1),
                }
                for k, raster in enumerate(rasters)
            ]
            + [{"label": label, "left_out": why} for label, why in left_out.items()],
        },
    )  # fmt: skip
    counts = store.counts()
    document.set_attribute("frames", counts.astype(np.int32))
    said = [
        f"{len(store):,} samples of {len(rasters)} frames"
        + (f", one in {nth}: {thinned} are left out" if nth > 1 else ""),
        f"{share(counts > 0)} of the texels seen",
    ]
    said += [f"exposure: {source}"] if source != "none" else []
    if spread > VARYING:
        said.append(
            f"the frames' brightness varies by {spread:.0%}: "
            + ("a gain per frame and channel is fitted" if use else "left as it is (gains=none)")
        )
    if step > STILLS:
        said.append(f"stills, {step:.0f}° apart")
    if unreadable:
        said.append(f"left out, unreadable: {', '.join(unreadable)}")
    return "; ".join(said)


def _readable(rasters, unreadable: str):
    """The frames whose files are there; the others named, in an error or in the result."""
    with Frames(rasters) as frames:
        found = {raster.label: frames.problem(raster) for raster in rasters}
        bad = {label: problem for label, problem in found.items() if problem}
        if unreadable == "skip":
            for raster in rasters:
                if raster.label not in bad:
                    try:
                        frames.read(raster)
                    except DocumentError as error:
                        bad[raster.label] = str(error)
    if bad and unreadable != "skip":
        problems = list(dict.fromkeys(bad.values()))
        listed = "; ".join(problems[:5]) + (" …" if len(problems) > 5 else "")
        raise DocumentError(
            f"{len(bad)} of {len(rasters)} frames cannot be read ({listed}): put them back, remove "
            "the rasters in MeshLab, or leave them out with unreadable=skip "
            "(meshlab-svbrdf run … --set compute_svbrdf_samples.unreadable=skip)"
        )
    return [r for r in rasters if r.label not in bad], bad


def _exposures(rasters, wanted: str) -> tuple[np.ndarray, str]:
    """Relative exposures (F,), median 1, and where they come from."""
    if wanted in ("auto", "raster"):
        values = [r.exposure for r in rasters]
        if None not in values:
            return np.array(values) / np.median(np.array(values)), "raster"
        if wanted == "raster":
            lacking = [r.label for r in rasters if r.exposure is None]
            raise DocumentError(f"rasters without svbrdf_exposure: {', '.join(lacking[:8])}")
    if wanted in ("auto", "exif"):
        frames = Frames(rasters)
        values = [frames.exposure(r) for r in rasters]
        if None not in values:
            return np.array(values) / np.median(np.array(values)), "exif"
        if wanted == "exif":
            lacking = [r.label for r, v in zip(rasters, values, strict=True) if v is None]
            raise DocumentError(f"frames without EXIF exposure: {', '.join(lacking[:8])}")
    return np.ones(len(rasters)), "none"


def _median_step(cameras: list[Camera], sequences: list[str], center: np.ndarray) -> float:
    """Degrees between a frame's view of the centre and the next one's, the median."""
    views = np.array([c.center - center for c in cameras])
    views /= np.maximum(np.linalg.norm(views, axis=1, keepdims=True), 1e-30)
    same = np.array([a == b for a, b in pairwise(sequences)], bool)
    cos = np.einsum("ij,ij->i", views[:-1], views[1:])[same]
    return float(np.degrees(np.median(np.arccos(np.clip(cos, -1, 1))))) if len(cos) else 0.0
