"""Rasters that a registration placed: what its JSON says, brought into the project.

    {"format": 1, "clips": [{"source": path | null, "video": bool, "frames": [
        {"label", "file", "index", "time", "used", "status", "reason", "residual", "inliers",
         "confidence", "blur", "camera": {...} | null, "lens": {...} | null}]}]}

A clip without a source is made of rasters that the project has: they keep their files. Exposures of
one view stand beside the clips, as `bracket_json` makes them: {"brackets": [{"label", "file",
"sequence", "mask", "exposure", "camera"}]}.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..geometry.camera import Camera
from ..geometry.lens import Lens
from .deep_images import kind_of
from .exposure import told_exposure
from .footage import Clip
from .project import Project, RasterEntry
from .project_entries import absolute, mask_beside
from .video_names import FRAMES, VideoFrame, name_frame, read_videos, write_videos

FORMAT = 1
UNDISTORTED = "undistorted"  # the folder in NAME.svbrdf
COLUMNS = (
    "clip", "label", "index", "time", "status", "used", "residual", "inliers", "confidence",
    "blur", "reason",
)  # fmt: skip


@dataclass(frozen=True)
class FrameReport:
    """What became of one frame.

    label : of the raster; file : the image, None for a frame of a video
    used : whether it is a raster of the project now
    camera : of the undistorted frame
    """

    label: str
    file: Path | None
    index: int
    time: float
    used: bool
    status: str
    reason: str
    residual: float
    inliers: int
    confidence: float
    blur: float
    camera: Camera | None
    lens: Lens | None = None


def clip_json(clip: Clip | None, frames: list[FrameReport]) -> dict[str, Any]:
    """One clip's entry in the JSON; None: of rasters that the project has."""
    return {
        "source": None if clip is None else clip.source.as_posix(),
        "video": clip is not None and clip.is_video,
        "frames": [
            asdict(frame) | {"file": None if frame.file is None else frame.file.as_posix()}
            for frame in frames
        ],
    }


def bracket_json(file: Path, model: RasterEntry, exposure: float) -> dict[str, Any]:
    """The entry of an image that shows what the raster `model` does, with its own exposure."""
    mask = mask_beside(file) or model.mask
    return {
        "label": file.name, "file": file.as_posix(), "sequence": model.sequence,
        "mask": None if mask is None else mask.as_posix(), "exposure": exposure,
        "camera": asdict(model.camera),
    }  # fmt: skip


def report_csv(clips: list[dict[str, Any]]) -> str:
    """A row per frame, for spreadsheets."""
    stream = io.StringIO()
    table = csv.DictWriter(stream, COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for clip in clips:
        name = Path(clip["source"]).name if clip["source"] else ""
        for frame in clip["frames"]:
            numbers = {
                key: ""
                if frame[key] is None or not np.isfinite(frame[key])
                else f"{frame[key]:.4g}"
                for key in ("residual", "confidence", "blur")
            }
            numbers["time"] = "" if not np.isfinite(frame["time"]) else f"{frame['time']:.4f}"
            table.writerow({**frame, **numbers, "clip": name, "used": int(frame["used"])})
    return stream.getvalue()


def _digits(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if np.isfinite(value) else ""


def undistorted_entry(source: Path, file: Path) -> str:
    """Where in NAME.svbrdf the undistorted image of a folder's `file` lies."""
    suffix = {"8": "jpg", "16": "png", "float": "exr"}[kind_of(file)]
    return f"{UNDISTORTED}/{source.name}/{file.stem}.{suffix}"


def missing_sources(told: dict[str, Any]) -> list[str]:
    """Videos and folders that the rasters are of, and that are not there."""
    sources = [clip["source"] for clip in told["clips"] if clip["source"]]
    return [source for source in sources if not Path(source).exists()]


def place_rasters(project: Project, folder: Path, told: dict[str, Any]) -> None:
    """Bring the project's rasters in line with what the registration says.

    Rasters that stood for the same frames before are replaced; of the others none changes.

    folder : of the results, NAME.svbrdf
    """
    for clip in told["clips"]:
        if clip["source"] is None:
            _move_cameras(project, clip["frames"])
        elif clip["video"]:
            _add_video_frames(project, folder, clip)
        else:
            _add_images(project, folder, clip)
    _add_brackets(project, told.get("brackets", ()))


def camera_from(told: dict[str, Any]) -> Camera:
    """The camera as the JSON has it."""
    intrinsics = {name: float(told[name]) for name in ("fx", "fy", "cx", "cy")}
    R, t = np.array(told["R"], np.float64), np.array(told["t"], np.float64)
    return Camera(int(told["width"]), int(told["height"]), **intrinsics, R=R, t=t)


def lens_from(told: dict[str, Any] | None) -> Lens | None:
    """The lens as the JSON has it."""
    if told is None:
        return None
    k1, k2, p1, p2, k3 = told["coefficients"]
    return Lens(**{**told, "coefficients": (k1, k2, p1, p2, k3)})


def _move_cameras(project: Project, frames: list[dict[str, Any]]) -> None:
    known = {frame["label"]: frame for frame in frames}
    kept = []
    for raster in project.rasters:
        frame = known.get(raster.label)
        if frame is not None and not frame["used"]:
            continue
        if frame is not None:
            raster.camera = camera_from(frame["camera"])
        kept.append(raster)
    project.rasters[:] = kept


def _add_video_frames(project: Project, folder: Path, clip: dict[str, Any]) -> None:
    video, frames_folder = absolute(clip["source"]), folder / FRAMES
    known = read_videos(frames_folder)
    _forget(project, {frames_folder / name for name, f in known.items() if f.video == video})
    known = {name: frame for name, frame in known.items() if frame.video != video}
    used = [frame for frame in clip["frames"] if frame["used"]]
    new: dict[str, VideoFrame] = {}
    for frame in used:
        lens = lens_from(frame["lens"])
        stands_for = VideoFrame(video, frame["index"], frame["time"], lens)
        new[name_frame(stands_for, known)] = stands_for
    write_videos(frames_folder, known | new)
    for name, frame in zip(new, used, strict=True):
        project.add_raster(name, frames_folder / name, camera_from(frame["camera"]))


def _add_images(project: Project, folder: Path, clip: dict[str, Any]) -> None:
    source = Path(clip["source"])
    places = {}
    for frame in clip["frames"]:
        file = Path(frame["file"])
        places[frame["label"]] = (
            file if frame["lens"] is None else folder / undistorted_entry(source, file)
        )
    files = {absolute(frame["file"]) for frame in clip["frames"]}
    _forget(project, files | {absolute(place) for place in places.values()})
    for frame in clip["frames"]:
        if not frame["used"]:
            continue
        file, path = Path(frame["file"]), places[frame["label"]]
        exposure = None if frame["lens"] is None else told_exposure(file)
        label = frame["label"]
        if any(raster.label == label for raster in project.rasters):
            label = f"{source.name}_{label}"
        project.add_raster(label, path, camera_from(frame["camera"]), exposure=exposure)


def _add_brackets(project: Project, shots: Sequence[dict[str, Any]]) -> None:
    """Rasters of these images, in this order, behind all others; what is known of them stays."""
    known = {raster.path: raster for raster in project.rasters}
    placed = []
    for shot in shots:
        path = absolute(shot["file"])
        camera = camera_from(shot["camera"])
        raster = known.get(path) or project.add_raster(
            shot["label"], path, camera, sequence=shot["sequence"], mask=shot["mask"]
        )
        raster.camera, raster.exposure, raster.sequence = camera, shot["exposure"], shot["sequence"]
        placed.append(raster)
    places = {raster.path for raster in placed}
    project.rasters[:] = [r for r in project.rasters if r.path not in places] + placed


def _forget(project: Project, paths: set[Path]) -> None:
    project.rasters[:] = [raster for raster in project.rasters if raster.path not in paths]
