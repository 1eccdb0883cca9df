"""From a video, or images in order, and one camera that is known to registered rasters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.footage import Clip, ClipFrames
from meshlab_svbrdf.document.registered import clip_json
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.results import Options, Registration
from meshlab_svbrdf.registration.track import register_frames

from ._clips import FOOTAGE, LENS, choose_frames, open_clips
from ._lens_search import estimate_lens
from ._registration import ORDER, REPORT, in_order, reports, stage, stage_undistorted
from ._starts import PICKED, STARTS, Start, find_starts, lens_of, solve_start

BRIDGEHEAD = 24  # frames of a registered clip that another one is matched with
SURE = 0.5  # confidence from which on a matched frame starts its clip

FILTER = Filter(
    name="generate_svbrdf_registered_rasters",
    title="SVBRDF: registered rasters from a video",
    needs=("mesh",),
    writes=("registration",),
    parameters=(
        *FOOTAGE,
        *STARTS,
        *LENS,
        Parameter(
            "refine_focal", "bool", False,
            help="Let the last adjustment of all cameras find the focal length too.",
        ),
        ORDER,
        *REPORT,
    ),
    help="Gives every frame of a video, or of a folder of images, its camera, from one frame whose "
    "camera is known, and adds the frames to the project as rasters. Of a video nothing is "
    "extracted. Frames that cannot be relied on are named and left out. Rasters that stood for "
    "the same frames before are replaced.",
    reference="Palma, Callieri, Dellepiane, Corsini, Scopigno 2010, "
    "Geometry-aware video registration",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    mesh = document.mesh()
    every = open_clips(document, parameters)
    starts = find_starts(document, every, parameters, progress.part(0, 0.05))
    places = [start.place for start in starts]
    clips = choose_frames(every, parameters, places, progress.part(0.05, 0.1))

    entries, said = [], []
    done: dict[int, tuple[ClipFrames, Registration]] = {}
    sources: list[ClipFrames] = []
    try:
        order = sorted(range(len(clips)), key=lambda c: all(p.clip != c for p in places))
        for nth, c in enumerate(order):
            part = progress.part(0.1 + 0.8 * nth / len(clips), 0.1 + 0.8 * (nth + 1) / len(clips))
            own = [
                replace(s, place=replace(s.place, frame=_place(clips[c], every[c], s)))
                for s in starts if s.place.clip == c
            ]  # fmt: skip
            frames, result, words = _register(mesh, clips[c], own, done, parameters, part)
            sources.append(frames)
            done[c] = frames, result
            said += words
        for c, clip in enumerate(clips):
            frames, result = done[c]
            report = reports(clip, result, frames.lenses, parameters.threshold, parameters.bridged)
            stage_undistorted(document, clip, frames, report)
            entries.append(clip_json(clip, report))
        outcome = stage(
            document, entries, lambda c, k: done[c][0][k], mesh, {"start": said},
            progress.part(0.9, 1),
        )  # fmt: skip
    finally:
        for frames in sources:
            frames.close()
    return f"{outcome}; start: {', '.join(said)}"


def _place(clip: Clip, every: Clip, start: Start) -> int:
    """Where among the chosen frames the start's is."""
    return clip.indices.index(every.indices[start.place.frame])


def _register(
    mesh: Mesh, clip: Clip, starts: list[Start], done: dict[int, tuple[ClipFrames, Registration]],
    parameters: Namespace, progress: Progress,
) -> tuple[ClipFrames, Registration, list[str]]:  # fmt: skip
    """One clip's frames and their cameras, and what is to be said of its start."""
    lens = lens_of(clip, starts, parameters)
    options = Options(
        ordered=in_order(clip, parameters.order), free_focal=parameters.refine_focal,
        cut=min(parameters.threshold, Options.cut),
    )  # fmt: skip
    if parameters.distortion.strip() == "auto":
        if starts:
            lens = estimate_lens(mesh, clip, starts, options, parameters, progress.part(0, 0.3))
        else:
            lens = next(iter(done.values()))[0].lenses[0] if done else None
    frames = ClipFrames(clip, [lens] * len(clip))
    words, errors = [], []
    cameras: dict[int, Camera] = {}
    for start in starts:
        camera, error, told = solve_start(
            mesh, clip, start, lens, frames, start.place.frame, parameters
        )  # fmt: skip
        cameras[start.place.frame] = _like(camera, cameras)
        words.append(told)
        errors.append(error)
    if not cameras:
        cameras = _from_others(mesh, clip, frames, done, options, progress.part(0.3, 0.5))
        words.append(f"{clip.source.name} from the frames before it")
    if lens is not None and parameters.distortion.strip() == "auto":
        words.append(f"distortion k1 {lens.coefficients[0]:+.4f}")
    options = replace(options, start_error=max(errors, default=PICKED * max(clip.size)))
    result = register_frames(
        mesh.vertices, mesh.faces, frames, cameras, options, progress.part(0.5, 1)
    )
    return frames, result, words


def _like(camera: Camera, others: dict[int, Camera]) -> Camera:
    """All frames of a clip have one focal length: that of the first start."""
    for first in others.values():
        return replace(camera, fx=first.fx, fy=first.fy, cx=first.cx, cy=first.cy)
    return camera


def _from_others(
    mesh: Mesh, clip: Clip, frames: ClipFrames,
    done: dict[int, tuple[ClipFrames, Registration]], options: Options, progress: Progress,
) -> dict[int, Camera]:  # fmt: skip
    """Cameras of some frames of a clip without a start, by likeness to clips that have cameras."""
    known: list[tuple[ClipFrames, int, Camera]] = []
    for other, result in done.values():
        if other.clip.size != clip.size:
            continue
        sure = [k for k, f in enumerate(result.frames) if f.camera and f.confidence >= SURE]
        for at in np.unique(np.linspace(0, len(sure) - 1, BRIDGEHEAD).astype(int)) if sure else ():
            camera = result.frames[sure[at]].camera
            assert camera is not None
            known.append((other, sure[at], camera))
    tried = np.unique(np.linspace(0, len(clip) - 1, BRIDGEHEAD).astype(int)).tolist()
    mixed = _Mixed([(source, k) for source, k, _ in known] + [(frames, k) for k in tried])
    found: dict[int, Camera] = {}
    if known:
        start = {n: camera for n, (_, _, camera) in enumerate(known)}
        loose = replace(options, ordered=False, adjust=False, free_focal=False)
        result = register_frames(mesh.vertices, mesh.faces, mixed, start, loose, progress)
        for k, frame in zip(tried, result.frames[len(known) :], strict=True):
            if frame.camera is not None and frame.confidence >= SURE:
                found[k] = frame.camera
    if not found:
        raise SvbrdfError(
            f"{clip.source}: none of its frames is like a frame whose camera is known; give a "
            "start for it: pick points in one of its frames, or align one as a raster"
        )
    return found


class _Mixed:
    """Frames of several clips, as one sequence."""

    def __init__(self, places: list[tuple[ClipFrames, int]]) -> None:
        self.places = places

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int, /) -> np.ndarray:
        frames, k = self.places[index]
        return frames[k]
