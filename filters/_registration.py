"""What registrations share: the core's call, the report, the contact sheet, undistorted images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from meshlab_svbrdf.document.deep_images import kind_of, read_values
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.exposure import read_exposure
from meshlab_svbrdf.document.footage import Clip, ClipFrames
from meshlab_svbrdf.document.images import read_mask, write_exr, write_jpeg, write_png
from meshlab_svbrdf.document.project_entries import mask_beside
from meshlab_svbrdf.document.registered import FORMAT, FrameReport, report_csv, undistorted_entry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.lens import Lens
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.overlay import (
    BAD,
    BRIDGED,
    GOOD,
    Picture,
    contact_sheet,
    draw_overlay,
    feature_edges,
)
from meshlab_svbrdf.registration.results import FrameResult, Registration

SHOWN = 30  # frames of a contact sheet, and as many again of those that were left out
THUMBNAIL = 320  # pixels
NAMED = 8  # frames that the outcome names

REPORT = (
    Parameter(
        "threshold", "float", 0.3, minimum=0.0, maximum=1.0,
        help="Frames of less confidence are no rasters. 0 keeps all that have a camera.",
    ),
    Parameter(
        "bridged", "bool", False,
        help="Keep frames whose camera was only set between their neighbours'.",
    ),
)  # fmt: skip
ORDER = Parameter(
    "order", "enum", "auto", choices=("auto", "video", "stills"),
    help="video: neighbouring frames show nearly the same. stills: photographs from anywhere. "
    "auto: images with an exposure in their EXIF are stills.",
)  # fmt: skip


def in_order(clip: Clip, order: str) -> bool:
    """Whether neighbouring frames show nearly the same."""
    if order != "auto":
        return order == "video"
    return clip.is_video or read_exposure(clip.files[0]) is None


def reports(
    clip: Clip, result: Registration, lenses: Sequence[Lens | None], threshold: float, bridged: bool
) -> list[FrameReport]:
    """The frames of one clip, with the verdict on each."""
    found = []
    for k, frame in enumerate(result.frames):
        used, reason = verdict(frame, threshold, bridged)
        found.append(
            FrameReport(
                clip.names[k], None if clip.is_video else clip.files[k], clip.indices[k],
                clip.times[k] if clip.times else float("nan"), used, frame.status, reason,
                frame.residual, frame.inliers, frame.confidence, frame.blur,
                frame.camera, lenses[k],
            )
        )  # fmt: skip
    return found


def verdict(frame: FrameResult, threshold: float, bridged: bool) -> tuple[bool, str]:
    """Whether a frame becomes a raster, and why not."""
    if frame.camera is None:
        return False, frame.reason or "no camera was found"
    if frame.status == "bridged":
        reason = frame.reason or "not measured, set between its neighbours"
        return bridged, reason
    if frame.confidence < threshold:
        return False, f"confidence {frame.confidence:.2f} is below {threshold:g}"
    return True, frame.reason


def stage(
    document: Document,
    clips: list[dict[str, Any]],
    pictures: Callable[[int, int], np.ndarray],
    mesh: Mesh,
    notes: dict[str, Any],
    progress: Progress,
) -> str:
    """Stage rasters, tables and the contact sheet; the outcome in words.

    clips : as `clip_json` makes them; pictures : the undistorted frame of a clip

    Raises SvbrdfError where no frame is left: the project stays as it was.
    """
    frames = [frame for clip in clips for frame in clip["frames"]]
    used = [frame for frame in frames if frame["used"]]
    out = [frame for frame in frames if not frame["used"]]
    if not used:
        first = out[0]
        raise SvbrdfError(
            f"none of {len(frames)} frames could be registered ({first['label']}: "
            f"{first['reason']}); see to the start, or lower threshold"
        )
    name = document.set_rasters({"format": FORMAT, "clips": clips, **notes})
    document.set_text(f"{name}.csv", report_csv(clips))
    document.set_image(name, _sheet(clips, pictures, mesh, progress), kind="png")

    # Say what became of the frames
    residual = [f["residual"] for f in used if np.isfinite(f["residual"])]
    said = f"{len(used)} of {len(frames)} frames registered"
    if residual:
        said += f", residual {np.median(residual):.2f} px (median), {max(residual):.2f} (largest)"
    if out:
        named = ", ".join(f"{f['label']} ({f['reason']})" for f in out[:NAMED])
        more = f" and {len(out) - NAMED} more in {name}.csv" if len(out) > NAMED else ""
        said += f"; left out: {named}{more}"
    return said


def stage_undistorted(
    document: Document, clip: Clip, frames: ClipFrames, report: list[FrameReport]
) -> None:
    """Stage the images of a folder that became rasters, and their masks, undistorted."""
    for k, frame in enumerate(report):
        lens = frames.lenses[k]
        if clip.is_video or lens is None or not frame.used:
            continue
        file = clip.files[k]
        path = document.staged_file(undistorted_entry(clip.source, file))
        if kind_of(file) == "8":
            write_jpeg(path, frames[k])
        else:  # all of its bits
            image = lens.undistort(read_values(file, label=frame.label, size=clip.size))
            write = write_png if image.dtype == np.uint16 else write_exr
            write(path, np.maximum(image, 0))
        mask = mask_beside(file)
        if mask is not None:
            shown = 255 * read_mask(mask, label=frame.label, size=clip.size).astype(np.uint8)
            entry = undistorted_entry(clip.source, file).rpartition("/")[0]
            path = document.staged_file(f"{entry}/masks/{file.stem}.png")
            write_png(path, np.where(lens.undistort(shown) > 127, 255, 0).astype(np.uint8))


def _sheet(
    clips: list[dict[str, Any]], pictures: Callable[[int, int], np.ndarray], mesh: Mesh,
    progress: Progress,
) -> np.ndarray:  # fmt: skip
    """Overlays of frames spread over the clips, and of those that were left out."""
    places = [(c, k) for c, clip in enumerate(clips) for k in range(len(clip["frames"]))]
    kept = [(c, k) for c, k in places if clips[c]["frames"][k]["used"]]
    out = [(c, k) for c, k in places if not clips[c]["frames"][k]["used"]]
    chosen = sorted({*_spread(kept, SHOWN), *_spread(out, SHOWN)})
    edges = feature_edges(mesh.vertices, mesh.faces)
    found = []
    for c, k in progress.over(chosen, "contact sheet"):
        frame = clips[c]["frames"][k]
        image = pictures(c, k)
        scale = THUMBNAIL / image.shape[1]
        size = (THUMBNAIL, max(1, round(image.shape[0] * scale)))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if frame["camera"] is not None:
            camera = _scaled(frame["camera"], size)
            small = draw_overlay(small, camera, mesh.vertices, mesh.faces, edges)
        color = GOOD if frame["used"] else BAD
        if frame["used"] and frame["status"] == "bridged":
            color = BRIDGED
        residual = frame["residual"]
        told = f"{residual:.2f} px" if np.isfinite(residual) else frame["status"]
        found.append(Picture(small, f"{frame['label']}  {told}", color))
    return contact_sheet(found)


def _spread(items: list[tuple[int, int]], most: int) -> list[tuple[int, int]]:
    if len(items) <= most:
        return items
    return [items[k] for k in np.linspace(0, len(items) - 1, most).round().astype(int)]


def _scaled(camera: dict[str, Any], size: tuple[int, int]) -> Camera:
    x, y = size[0] / camera["width"], size[1] / camera["height"]
    return Camera(
        *size, camera["fx"] * x, camera["fy"] * y, (camera["cx"] + 0.5) * x - 0.5,
        (camera["cy"] + 0.5) * y - 0.5, np.asarray(camera["R"]), np.asarray(camera["t"]),
    )  # fmt: skip
