"""The performance workload: a scan, frames of it in full HD, their cameras, and the truth.

make_workload   into a folder, or what is lacking there; frames are made once
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..document.mesh_files import write_ply
from ..document.project import new_project, write_project
from ..document.video_rasters import add_video
from ..errors import SvbrdfError
from ..geometry.camera import Camera
from ..geometry.texels import Texels, rasterise_texels
from .body import body
from .files import SUFFIXES, ahead, write_image, write_video
from .scene import BenchScene
from .truth import write_truth, write_views
from .walk import frame_camera, turn_of

VERSION = 1  # of the generator: raise it when the same options give other files


@dataclass(frozen=True)
class Options:
    """triangles : about how many; width, height : pixels; format : one of SUFFIXES

    quality : of JPEG; noise : standard deviation in code values; step : degrees between frames;
    truth : side of the image of the true D
    """

    triangles: int = 200_000
    width: int = 1920
    height: int = 1080
    format: str = "jpeg"
    quality: int = 95
    noise: float = 1.5
    step: float = 1.0
    truth: int = 1024
    seed: int = 0


@dataclass(frozen=True)
class Workload:
    """A made workload of so many frames."""

    folder: Path
    options: Options
    scene: BenchScene
    frames: int

    @property
    def project(self) -> Path:
        """The project of all frames."""
        return self.first(self.frames)

    def first(self, frames: int, tiles: bool = False) -> Path:
        """A project of the first frames, written where it is not there yet.

        tiles : with the object's charts in UDIM tiles
        """
        stem = "tiles" if tiles else "bench"
        path, mesh = self.folder / f"{stem}_{frames:05d}.mlp", self.folder / f"{stem}.ply"
        if frames > self.frames:
            raise ValueError(f"{frames} frames of a workload of {self.frames}")
        if not path.is_file():
            if tiles and not mesh.is_file():
                write_ply(mesh, body(self.options.triangles, tiles))
            project = new_project()
            project.add_mesh("bench", mesh)
            for turn, indices in self.turns(frames).items():
                cameras = {index: self.camera(index) for index in indices}
                if self.options.format == "h264":
                    own = {index - indices[0]: camera for index, camera in cameras.items()}
                    add_video(project, path.with_suffix(".svbrdf"), self.video(turn), own)
                    continue
                for index, camera in cameras.items():
                    frame = self.frame_path(index)
                    label = f"{frame.parent.name}_{frame.name}"
                    project.add_raster(label, frame, camera, sequence=frame.parent.name)
            write_project(project, path)
        return path

    def turns(self, frames: int) -> dict[int, list[int]]:
        """The first frames by the walk around the object that they are of."""
        found: dict[int, list[int]] = {}
        for index in range(frames):
            found.setdefault(turn_of(index, self.options.step), []).append(index)
        return found

    def video(self, turn: int) -> Path:
        """Of one turn: one that has its frames, if only as its first ones; else the one to make."""
        count = len(self.turns(self.frames)[turn])
        made = sorted(self.folder.glob(f"turn{turn:02d}_*.mp4"))
        long = [path for path in made if int(path.stem.split("_")[1]) >= count]
        return (long or [self.folder / f"turn{turn:02d}_{count:05d}.mp4"])[0]

    @property
    def bytes(self) -> int:
        """On the disk, of all frames (of whole videos)."""
        turns = self.turns(self.frames)
        paths = (
            [self.video(turn) for turn in turns]
            if self.options.format == "h264"
            else [self.frame_path(index) for index in range(self.frames)]
        )
        return sum(path.stat().st_size for path in paths)

    def camera(self, index: int) -> Camera:
        o = self.options
        return frame_camera(index, o.width, o.height, self.scene.reach, o.step)

    def frame_path(self, index: int) -> Path:
        """The image of a frame, where frames are images."""
        turn, suffix = turn_of(index, self.options.step), SUFFIXES[self.options.format]
        return self.folder / f"turn{turn:02d}" / f"{index:05d}{suffix}"

    def frame(self, index: int) -> np.ndarray:
        """Render a frame, (H, W, 3) uint8 sRGB."""
        return self.scene.frame(self.camera(index), index)

    def texels(self, size: int) -> Texels:
        return rasterise_texels(self.scene.mesh, ((size, size),))

    def views(self) -> Path:
        """A project of views that no frame has, rendered without noise."""
        path = self.folder / "ground_truth" / "views" / "project.mlp"
        if not path.is_file():
            size = self.options.width // 2, self.options.height // 2
            write_views(path, self.scene, self.folder / "bench.ply", size)
        return path


def default_folder() -> Path:
    """Where workloads are kept: the user's cache."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "meshlab-svbrdf" / "bench"


def make_workload(
    folder: Path | None,
    frames: int,
    options: Options | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Workload:
    """Make a workload; frames that are there already are taken as they are.

    Parameters
    ----------
    folder : gets a folder for each kind of workload; None: the user's cache
    frames : how many; fewer than are there is as good
    progress : called with the frames made, and all

    Raises
    ------
    SvbrdfError : no such format.
    """
    options = options or Options()
    if options.format not in SUFFIXES:
        raise SvbrdfError(
            f"format: expected one of {', '.join(SUFFIXES)}, found {options.format!r}"
        )
    words = json.dumps([VERSION, asdict(options)], sort_keys=True)
    name = f"{options.width}x{options.height}_{options.format}_{_digest(words)}"
    place = (folder or default_folder()).absolute() / name
    place.mkdir(parents=True, exist_ok=True)
    scene = BenchScene(options.triangles, options.noise, options.seed)
    workload = Workload(place, options, scene, frames)
    if not (place / "bench.ply").is_file():
        write_ply(place / "bench.ply", scene.mesh)
    if not (place / "ground_truth" / "lights.json").is_file():
        write_truth(place / "ground_truth", scene, workload.texels(options.truth))
    if options.format == "h264":
        _write_videos(workload, progress)
    else:
        _write_images(workload, progress)
    return workload


def _write_images(workload: Workload, progress: Callable[[int, int], None]) -> None:
    todo = [k for k in range(workload.frames) if not workload.frame_path(k).is_file()]
    if todo:
        _ = workload.scene.seen  # once, not once a thread

    def make(index: int) -> None:
        quality = workload.options.quality
        write_image(workload.frame_path(index), workload.frame(index), quality)

    for done, _ in enumerate(ahead(make, todo)):
        progress(done + 1, len(todo))


def _write_videos(workload: Workload, progress: Callable[[int, int], None]) -> None:
    turns = workload.turns(workload.frames)
    todo = [turn for turn in turns if not workload.video(turn).is_file()]
    if todo:
        _ = workload.scene.seen  # once, not once a thread
    for turn in todo:
        write_video(workload.video(turn), ahead(workload.frame, turns[turn]))
        progress(turns[turn][-1] + 1, workload.frames)


def _digest(words: str) -> str:
    return hashlib.sha256(words.encode()).hexdigest()[:8]
