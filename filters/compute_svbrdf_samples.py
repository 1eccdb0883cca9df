"""Projecting the frames to the texels, once."""

from __future__ import annotations

from itertools import takewhile

import numpy as np

from meshlab_svbrdf.document.deep_images import is_exr
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.samples.gains import frame_gains, gain_spread
from meshlab_svbrdf.samples.observations import observe
from meshlab_svbrdf.samples.radiance_code import LARGEST
from meshlab_svbrdf.samples.steadiness import light_steadiness
from meshlab_svbrdf.samples.transfer import TRANSFERS

from ._brackets import ALIKE
from ._coding import how_frames_are_coded, with_white
from ._frames import choose, median_step, reduction
from ._outlines import look_at_outlines
from ._samples import project_frames
from ._stages import counted, share

VARYING = 0.03  # robust spread of ln gain; a locked exposure leaves .003
CHANGED = 0.03
"""Of ln brightness of one side over the other: .01 at most under steady light, .02 with much gloss;
.04 to .2 where what faces one way gets 30 % less from the middle on (docs/stability.md)."""
FICKLE = 0.06
"""Of ln brightness from frame to frame: texels that change more are all gloss, and tell nothing of
the light. Gold has .1, other films up to .03."""
STILLS = 5.0  # degrees between neighbouring cameras from which frames are no video

FILTER = Filter(
    name="compute_svbrdf_samples",
    title="SVBRDF: samples",
    needs=("mesh", "rasters", "texels"),
    writes=("samples",),
    version=5,
    parameters=(
        Parameter(
            "exposure", "enum", "auto", choices=("auto", "exif", "raster", "none"),
            help="Divides frames by their exposure: the attribute svbrdf_exposure of each raster "
            '("raster"), ExposureTime · ISO / FNumber² of each photograph ("exif"), the first of '
            'the two that every frame has ("auto"), or "none". EXPOSURE of a Radiance HDR counts '
            "as exif; expTime, isoSpeed and aperture of an OpenEXR only where exif is given.",
        ),
        Parameter(
            "gains", "enum", "auto", choices=("auto", "fit", "none"),
            help="Divides frames by a gain per channel, fitted from the texels that they share. "
            '"auto" does so where their brightness or white balance varies by more than 3 %, and '
            "says it.",
        ),
        Parameter(
            "transfer", "enum", "auto", choices=("auto", *TRANSFERS, "estimate"),
            help="What the numbers of coded frames (8 and 16 bits, videos) say of light: sRGB, "
            "linear, Rec. 709, PQ, HLG, or a camera's log curve. auto: PQ, HLG and linear light "
            "where a video's tags say so, else sRGB. estimate: measured from exposures of the "
            "same views. OpenEXR, Radiance HDR and TIFF of floats are linear light in any case.",
        ),
        Parameter(
            "clip", "float", 0.0, minimum=0.0, maximum=LARGEST,
            help="From where on a channel may have been brighter: of coded frames the signal, "
            "0..1, of floats the light. 0: the last codes of coded frames, and no floats.",
        ),
        Parameter(
            "brackets", "enum", "auto", choices=("auto", "none"),
            help="Merges rasters of one sequence that have the same camera and different exposures "
            "(svbrdf_exposure, or EXIF) to one view, in linear light.",
        ),
        Parameter(
            "white", "float", 0.0, minimum=0.0, maximum=LARGEST,
            help="The light that results call 1, in the frames' own units. 0: 1 where the "
            "brightest diffuse texels lie in .05 to 1 then, as those of 8-bit sRGB do, else the "
            "power of two above them.",
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
            "frames", "int", 0, minimum=0, maximum=1_000_000,
            help="Use about so many frames at most, spread evenly over the places from which the "
            "object was seen, never chosen by what they show. 0: no limit.",
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
            "reduce", "enum", "auto", choices=("auto", "1", "2", "4"),
            help="Samples frames reduced to a half or a quarter of their width, of which JPEGs are "
            'read faster: "auto" does so where texels are as coarse as that.',
        ),
        Parameter(
            "store", "enum", "disk", choices=("disk", "memory"),
            help='Where the samples go. "memory": nowhere; another run that needs them projects '
            "the frames again.",
        ),
        Parameter(
            "memory", "int", 128, minimum=16, maximum=65536, unit="MiB",
            help="Of samples held before a chunk is written.",
        ),
    ),
    help="Projects every frame to the texels: depth test, quality (distance to depth jumps, "
    "nearness, angle), colour interpolated in linear light. Frames are streamed, one after the "
    "other; the samples go to the sample store, 5 bytes each, or 9 of frames with more than 8 "
    "bits. Frames that an earlier run has projected alike are not projected again.",
    reference="Palma et al. 2012, §4; Callieri et al. 2008",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    mesh = document.mesh()
    choice = choose(document, parameters, mesh)
    sequences = choice.sequences
    shots = [shot for own in choice.brackets.values() for shot, _ in own[1:]]
    found, unreadable = _readable([*choice.rasters, *shots], parameters.unreadable)
    rasters = [raster for raster in choice.rasters if raster in found]
    left_out = choice.left_out | unreadable
    if not rasters:
        raise SvbrdfError("no frame is left to sample")

    # See how their numbers stand for light
    brackets = {
        label: [(raster, exposure) for raster, exposure in own if raster in found]
        for label, own in choice.brackets.items()
    }
    deep, coded = how_frames_are_coded(mesh, found, brackets, parameters)

    # Project them
    texels = document.texels()
    cameras = [raster.camera for raster in rasters]
    reduce = reduction(parameters, mesh, max(max(size) for size in texels.sizes), cameras)
    in_memory = parameters.store == "memory"
    store = project_frames(
        document, mesh, texels, rasters, parameters, reduce,
        None if in_memory else document.staged_folder("samples"), deep,
        counted(progress.part(0, 0.9), "frames"),
    )  # fmt: skip
    if in_memory:
        document.hold("samples", store)
    if len(store) == 0:
        raise SvbrdfError(
            "no texel is seen in any frame: check that the rasters are aligned to this mesh "
            "(in MeshLab, show a raster and look whether the mesh covers the object)"
        )

    # See whether the frames show this object from where their cameras say
    progress(0.9, "looking at outlines")
    outline, misfit = look_at_outlines(mesh, rasters)

    # Bring the frames to one exposure
    exposure, source = _exposures(rasters, parameters.exposure)
    progress(0.92, "comparing the frames' brightness")
    deep, white, levels = with_white(deep, store, exposure, parameters.white)
    observations = observe(texels, store, cameras, mesh.faces, gains=white * exposure)
    fitted, residual = frame_gains(observations)
    spread = gain_spread(fitted)
    use = parameters.gains == "fit" or (parameters.gains == "auto" and spread > VARYING)
    gain = exposure[:, None] * (np.where(np.isfinite(fitted), fitted, 1.0) if use else 1.0)
    gain = np.broadcast_to(gain / np.median(gain), (len(rasters), 3))
    step = median_step(cameras, [r.sequence for r in rasters], texels.center)
    steady = light_steadiness(observations, gain[:, 1] / exposure)

    document.set_array("samples_gain", white * gain)
    document.set_array(
        "samples_sequence", np.array([sequences.index(r.sequence) for r in rasters], np.int32)
    )
    document.set_array(
        "samples_order", np.array([choice.order[r.label] for r in rasters], np.int32)
    )
    document.set_json(
        "frames",
        {
            "exposure": source,
            "reduce": reduce,
            "coding": None if deep is None else deep.coding.to_json(),
            "gains_fitted": use,
            "gain_spread": spread,
            "median_step_degrees": step,
            "stills": bool(step > STILLS),
            "outline": outline,
            "light_change": steady._asdict() if steady else None,
            "frames": [
                {
                    "label": raster.label, "sequence": raster.sequence, "gain": gain[k],
                    "samples": int(store.seen[k]), "residual": residual[k],
                    "quality": store.quality[k],
                    "merged": [[r.label, e] for r, e in brackets.get(raster.label, ())],
                }
                for k, raster in enumerate(rasters)
            ]
            + [{"label": label, "left_out": why} for label, why in left_out.items()],
        },
    )  # fmt: skip
    counts = store.counts()
    document.set_attribute("frames", counts.astype(np.int32))
    said = [
        f"{len(store):,} samples of {len(rasters)} frames{choice.said}",
        f"{share(counts > 0)} of the texels seen",
    ]
    said += [f"frames reduced to 1/{reduce}: texels are coarser"] if reduce > 1 else []
    said += [coded] if coded else []
    said += levels
    said += [f"exposure: {source}"] if source != "none" else []
    if parameters.exposure == "auto" and (apart := _untrusted(rasters)) > ALIKE:
        said.append(
            f"the headers of the OpenEXR frames tell exposures up to {apart:.3g} times apart, "
            "which are not used, for pixels may have been divided by them: exposure=exif uses them"
        )
    if spread > VARYING:
        said.append(
            f"the frames' brightness varies by {spread:.0%}: "
            + ("a gain per frame and channel is fitted" if use else "left as it is (gains=none)")
        )
    if step > STILLS:
        said.append(f"stills, {step:.0f}° apart")
    said += [misfit] if misfit else []
    if not misfit and steady and steady.turns < FICKLE and steady.sides > CHANGED:
        said.append(
            f"in the second half of the frames one side of the object is "
            f"{np.expm1(steady.sides):.0%} brighter than in the first, next to the other side: the "
            "light changed between; use frames of one light"
        )
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
        frames, asked = Frames(rasters), wanted == "exif"
        told = (frames.exposure(r, asked=asked) for r in rasters)
        values = list(takewhile(lambda value: value is not None, told))  # else asks no further
        if len(values) == len(rasters):
            return np.array(values) / np.median(np.array(values)), "exif"
        if asked:
            lacking = [r.label for r in rasters if frames.exposure(r, asked=True) is None]
            raise DocumentError(f"frames without EXIF exposure: {', '.join(lacking[:8])}")
    return np.ones(len(rasters)), "none"


def _untrusted(rasters) -> float:
    """How far exposures are apart that only OpenEXR's headers tell; 1 where none are told."""
    frames = Frames(rasters)
    untold = [r for r in rasters if r.exposure is None and is_exr(frames.file(r))]
    told = [e for r in untold if (e := frames.exposure(r, asked=True)) is not None]
    return max(told) / min(told) if told else 1.0
