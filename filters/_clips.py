"""Which frames are registered: the footage's parameters, and frames found by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import cv2
import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.focal_length import read_focal_length
from meshlab_svbrdf.document.footage import Clip, ClipFrames, open_images, open_video
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.project_entries import absolute
from meshlab_svbrdf.document.video_names import FRAMES, VideoFrame, read_videos
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace, Parameter
from meshlab_svbrdf.geometry.lens import Lens
from meshlab_svbrdf.progress import Progress

ALIKE = 8.0  # of 255: mean difference of small pictures below which frames are the same one
SMALL = (64, 48)

FOOTAGE = (
    Parameter("video", "paths", "", help="Videos; several are registered one after the other."),
    Parameter(
        "images", "path", "",
        help="A folder of images in place of a video, in natural order (f2 before f10).",
    ),
    Parameter("step", "int", 1, minimum=1, maximum=100000, help="Use every n-th frame."),
    Parameter("first", "int", 0, minimum=0, maximum=10**9, help="The first frame, from 0."),
    Parameter("last", "int", -1, minimum=-1, maximum=10**9, help="The last frame; -1: the end."),
    Parameter(
        "sharpest", "bool", False,
        help="Of every `step` frames use the sharpest, not the first. All are decoded once more.",
    ),
)  # fmt: skip
LENS = (
    Parameter(
        "focal", "float", 0.0, minimum=0.0, maximum=1e6, unit="pixels",
        help="Focal length of the frames. 0: `focal_mm`, else the start's, else EXIF's, else it is "
        "estimated from the picked points.",
    ),
    Parameter(
        "focal_mm", "float", 0.0, minimum=0.0, maximum=1e5, unit="mm",
        help="Focal length with `sensor_width`, where that is what is known.",
    ),
    Parameter(
        "sensor_width", "float", 36.0, minimum=0.1, maximum=1000.0, unit="mm",
        help="The longer side of the sensor that the frames use; 36: `focal_mm` is for 35 mm film.",
    ),
    Parameter(
        "distortion", "string", "",
        help='The lens, "k1 k2 p1 p2 k3" of OpenCV\'s model (the last ones may be left out), for '
        "frames as they were filmed. auto: k1 is estimated from the footage. Empty: no distortion.",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Place:
    """A frame: of which clip, and where in it."""

    clip: int
    frame: int


def open_clips(document: Document, parameters: Namespace) -> list[Clip]:
    """Every frame of the footage that the parameters name.

    Raises SvbrdfError where they name none, or both a video and images.
    """
    if bool(parameters.video) == (parameters.images is not None):
        raise SvbrdfError("give the frames: either video=FILE (or several), or images=FOLDER")
    if parameters.images is not None:
        return [open_images(parameters.images)]
    if len(set(parameters.video)) < len(parameters.video):
        raise SvbrdfError("the same video is given twice; give each once")
    known = read_videos(document.folder / FRAMES)
    clips = []
    for path in parameters.video:
        video = absolute(path)
        others = {name: f for name, f in known.items() if f.video != video}
        clips.append(open_video(video, others))
        known = others | {n: VideoFrame(video, 0, clips[-1].times[0]) for n in clips[-1].names[:1]}
    return clips


def choose_frames(
    clips: list[Clip], parameters: Namespace, starts: Sequence[Place], progress: Progress
) -> list[Clip]:
    """The clips with the frames that the parameters choose, and those that starts are given for."""
    found = []
    for k, clip in enumerate(clips):
        always = [clip.indices[place.frame] for place in starts if place.clip == k]
        found.append(
            clip.chosen(
                parameters.step, parameters.first, parameters.last, sharpest=parameters.sharpest,
                always=always, progress=progress.part(k / len(clips), (k + 1) / len(clips)),
            )
        )  # fmt: skip
    return found


def find_frame(clips: list[Clip], name: str, where: str, nth: int = 0) -> Place:
    """The frame that a file calls `name`.

    A file name with or without its suffix; "walk.mp4#120" or 120, counted from 0; "": the first
    frame of the `nth` clip.

    Raises SvbrdfError where no frame, or more than one, is called so.
    """
    if not name:
        if nth < len(clips):
            return Place(nth, 0)
        raise SvbrdfError(f"{where}: names no frame, and there are {len(clips)} clips only")
    base = PureWindowsPath(name).name
    stem = PureWindowsPath(base).stem
    source, hash_sign, number = base.rpartition("#")
    found: list[Place] = []
    for k, clip in enumerate(clips):
        if hash_sign and source in (clip.source.name, clip.source.stem) and number.isdigit():
            found += [Place(k, at) for at, i in enumerate(clip.indices) if i == int(number)]
        elif base in clip.names:
            found.append(Place(k, clip.names.index(base)))
    if not found:
        for k, clip in enumerate(clips):
            stems = [Path(each).stem for each in clip.names]
            found += [Place(k, at) for at, each in enumerate(stems) if each == stem]
    if not found and name.isdigit() and len(clips) == 1 and int(name) in clips[0].indices:
        found = [Place(0, clips[0].indices.index(int(name)))]
    if len(found) != 1:
        what = "no frame" if not found else f"{len(found)} frames"
        raise SvbrdfError(
            f"{where}: {what} of the footage is called {name!r}; the frames are called "
            f"{clips[0].names[0]} to {clips[-1].names[-1]}, or {clips[0].source.name}#0"
        )
    return found[0]


def find_raster(clips: list[Clip], raster: RasterEntry, progress: Progress) -> Place:
    """The frame that a raster shows: the same file, the same name, else the same picture.

    Raises SvbrdfError where no frame is that picture.
    """
    with Frames([raster]) as frames:
        video = frames.videos.get(raster.path)
        for k, clip in enumerate(clips):
            if video is not None and clip.is_video and clip.source == video.video:
                times = np.abs(np.array(clip.times) - video.time)
                return Place(k, int(times.argmin()))
            for at, file in enumerate(clip.files):
                if file == raster.path:
                    return Place(k, at)
        shown = frames.read(raster)

    # Look for the picture
    small = _small(shown)
    best, place = np.inf, Place(0, 0)
    for k, clip in enumerate(clips):
        if clip.size != (raster.camera.width, raster.camera.height):
            continue
        with ClipFrames(clip) as pixels:
            for at in progress.over(range(len(clip)), f"looking for {raster.label}"):
                difference = float(np.abs(_small(pixels.raw(at)) - small).mean())
                if difference < best:
                    best, place = difference, Place(k, at)
    if best > ALIKE:
        raise SvbrdfError(
            f"raster {raster.label!r} is no frame of the footage: the most alike differs by "
            f"{best:.0f} of 255; align a frame that was extracted from it, at its full size"
        )
    return place


def focal_length(clip: Clip, parameters: Namespace) -> float | None:
    """Pixels, as it was given or as EXIF has it; None where it is not known."""
    if parameters.focal > 0:
        return parameters.focal
    if parameters.focal_mm > 0:
        return parameters.focal_mm / parameters.sensor_width * max(clip.size)
    return None if clip.is_video else read_focal_length(clip.files[0])


def coefficients(text: str) -> tuple[float, float, float, float, float] | None:
    """What `distortion` says; None where it says nothing."""
    words = text.replace(",", " ").split()
    if not words:
        return None
    try:
        k = [float(word) for word in words]
        if len(k) > 5 or not np.isfinite(k).all():
            raise ValueError
    except ValueError:
        raise SvbrdfError(
            f'parameter distortion is {text!r}, expected "k1 k2 p1 p2 k3", auto or nothing'
        ) from None
    k += [0.0] * (5 - len(k))
    return k[0], k[1], k[2], k[3], k[4]


def centred_lens(clip: Clip, focal: float, k: tuple[float, float, float, float, float]) -> Lens:
    """A lens whose axis meets the frame's middle; SvbrdfError where it folds the frame."""
    width, height = clip.size
    lens = Lens(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, k)
    try:
        lens.pinhole()
    except ValueError as error:
        raise SvbrdfError(
            f"parameter distortion: {error}, at a focal length of {focal:.0f}"
        ) from None
    return lens


def _small(image: np.ndarray) -> np.ndarray:
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, SMALL, interpolation=cv2.INTER_AREA).astype(np.float32)
