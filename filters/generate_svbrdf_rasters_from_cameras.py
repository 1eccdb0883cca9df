"""Cameras of another program (COLMAP, Bundler, Metashape) refined against the mesh."""

from __future__ import annotations

from pathlib import Path

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.footage import Clip, ClipFrames
from meshlab_svbrdf.document.reconstruction import ForeignCamera, read_reconstruction
from meshlab_svbrdf.document.registered import clip_json
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Namespace, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.lens import Lens
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.refine import refine_cameras
from meshlab_svbrdf.registration.results import FrameResult, Options, Registration

from ._alignment import align
from ._clips import FOOTAGE, Place, choose_frames, find_frame, open_clips
from ._registration import ORDER, REPORT, in_order, reports, stage, stage_undistorted

FILTER = Filter(
    name="generate_svbrdf_rasters_from_cameras",
    title="SVBRDF: registered rasters from cameras of another program",
    needs=("mesh",),
    writes=("registration",),
    parameters=(
        Parameter(
            "cameras", "path", "",
            help="The folder of a COLMAP model (text or binary), Bundler's bundle.out with its "
            "list.txt, Metashape's cameras.xml, a cameras.json, or a MeshLab project.",
        ),
        *FOOTAGE,
        Parameter(
            "align", "enum", "auto", choices=("auto", "none", "pairs", "rasters", "points"),
            help="What brings scale and pose to the mesh's. pairs: of points in both worlds. "
            "rasters: three or more rasters of the project that show the same images. points: the "
            "reconstruction's own points, laid on the mesh. none: they are the mesh's already. "
            "auto: the first of pairs, rasters and points that there are data for.",
        ),
        Parameter(
            "pairs", "path", "",
            help="Three or more points in both worlds: a text of lines x, y, z, X, Y, Z.",
        ),
        Parameter("refine", "bool", True, help="Refine the cameras against the mesh."),
        Parameter(
            "refine_focal", "bool", False,
            help="Let the last adjustment of all cameras find the focal length too.",
        ),
        ORDER,
        *REPORT,
    ),
    help="Reads cameras from elsewhere, brings them to the mesh as a whole, refines each against "
    "it, and adds the frames as rasters, undistorted where the lens distorts. Frames without a "
    "camera, or that cannot be relied on, are named and left out.",
)  # fmt: skip


def apply(document: Document, parameters: Namespace, progress: Progress) -> str:
    if parameters.cameras is None:
        raise SvbrdfError("give the cameras: cameras=FOLDER of COLMAP, or a file")
    mesh = document.mesh()
    every = open_clips(document, parameters)
    reconstruction = read_reconstruction(parameters.cameras, lambda name: _size(every, name))
    placed = _placed(reconstruction.cameras, every, parameters.cameras)
    move, aligned = align(
        reconstruction, parameters.align, parameters.pairs, document.project.rasters, mesh
    )
    clips = choose_frames(every, parameters, [], progress.part(0, 0.1))

    entries, sources = [], []
    try:
        for c, clip in enumerate(clips):
            part = progress.part(0.1 + 0.8 * c / len(clips), 0.1 + 0.8 * (c + 1) / len(clips))
            own = {
                k: placed[c, index] for k, index in enumerate(clip.indices) if (c, index) in placed
            }
            lenses: list[Lens | None] = [None] * len(clip)
            cameras: dict[int, Camera] = {}
            for k, foreign in own.items():
                lenses[k] = foreign.lens if foreign.lens.distorts else None
                cameras[k] = move.camera(foreign.pinhole())
            frames = ClipFrames(clip, lenses)
            sources.append(frames)
            if parameters.refine and cameras:
                options = Options(
                    ordered=in_order(clip, parameters.order), free_focal=parameters.refine_focal,
                    cut=min(parameters.threshold, Options.cut),
                )  # fmt: skip
                result = refine_cameras(mesh.vertices, mesh.faces, frames, cameras, options, part)
            else:
                result = _as_given(clip, cameras, parameters.cameras)
            report = reports(clip, result, lenses, parameters.threshold, parameters.bridged)
            stage_undistorted(document, clip, frames, report)
            entries.append(clip_json(clip, report))
        outcome = stage(
            document, entries, lambda c, k: sources[c][k], mesh,
            {"cameras": parameters.cameras, "aligned": aligned}, progress.part(0.9, 1),
        )  # fmt: skip
    finally:
        for frames in sources:
            frames.close()
    return f"{outcome}; aligned by {aligned}"


def _placed(
    cameras: list[ForeignCamera], clips: list[Clip], path: Path
) -> dict[tuple[int, int], ForeignCamera]:
    """The cameras by clip and by the frame's index in its source."""
    found: dict[tuple[int, int], ForeignCamera] = {}
    last = ""
    for camera in cameras:
        where = f"{path}: {camera.name}"
        try:
            place: Place = find_frame(clips, camera.name, where)
        except SvbrdfError as error:
            last = str(error)
            continue
        clip = clips[place.clip]
        if (camera.lens.width, camera.lens.height) != clip.size:
            raise SvbrdfError(
                f"{where}: is of {camera.lens.width}×{camera.lens.height} pixels, the frame "
                f"{clip.names[place.frame]} has {clip.size[0]}×{clip.size[1]}; give the frames "
                "that the other program was given"
            )
        found[place.clip, clip.indices[place.frame]] = camera
    if not found:
        raise SvbrdfError(f"none of {len(cameras)} cameras is of a frame: {last}")
    return found


def _size(clips: list[Clip], name: str) -> tuple[int, int] | None:
    try:
        return clips[find_frame(clips, name, name).clip].size
    except SvbrdfError:
        return None


def _as_given(clip: Clip, cameras: dict[int, Camera], path: Path) -> Registration:
    """The cameras as they came, where they are not to be refined."""
    missing = FrameResult(None, "unregistered", f"no camera in {path.name}")
    frames = [
        FrameResult(cameras[k], "given", confidence=1.0) if k in cameras else missing
        for k in range(len(clip))
    ]
    return Registration(frames, [])
