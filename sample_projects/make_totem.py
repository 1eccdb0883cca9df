"""Make a sample project: video frames of a lidded vessel, its scan, and the truth about both.

    python -m sample_projects.make_totem --out FOLDER [--frames 240 --width 300 --height 400 …]

Nothing here uses the suite's own rasteriser, sampling or reflectance: pixels are traced by Embree,
several jittered rays each, and shaded by the paper's eq. 1, so results can be judged against them.
Equal options give equal files (JPEG: as equal as the JPEG library's versions are).

For tests: `make_totem(folder, TINY)`, or `replace(TINY, …)`; for arrays alone `make_scene`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh

from .procedural.capture import Scene, developed, picture
from .procedural.paint import Atlas
from .procedural.recipe import ORBITS, TINY, Options, make_scene
from .procedural.truth import lights_record, write_json, write_truth

__all__ = ["TINY", "Frame", "Options", "Totem", "make_scene", "make_totem", "placed"]


@dataclass(frozen=True)
class Frame:
    """label : file name; folder : its orbit; camera : in the world; exposure : 1 is the truth's."""

    label: str
    folder: str
    camera: Camera
    exposure: float


@dataclass(frozen=True)
class Totem:
    """A made project: where it lies, and what made it (scene and atlas in the object's frame)."""

    path: Path
    scene: Scene
    atlas: Atlas
    mesh: Mesh
    frames: list[Frame]
    views: list[Camera]


def make_totem(folder: Path, options: Options) -> Totem:
    """Write scan, frames, project and truth into a new folder (`totem.mlp` last).

    Raises
    ------
    DocumentError : the folder holds something already.
    """
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()):
        raise DocumentError(f"{folder}: is not empty; choose another folder or empty this one")
    truth = folder / "ground_truth"
    (truth / "views").mkdir(parents=True)
    scene, atlas, orbits, views = make_scene(options)
    own = scene.surface.mesh
    world = own.transformed(options.world)

    # The scan
    scan = own if options.layer_matrix else world
    write_ply(folder / "totem.ply", scan if options.uv else replace(scan, uv=None))
    project = new_project()
    matrix = options.world if options.layer_matrix else np.eye(4)
    project.add_mesh("totem", folder / "totem.ply", matrix)

    # The frames
    frames = []
    for k, cameras in enumerate(orbits):
        name = ORBITS[k][0]
        (folder / name).mkdir()
        for index, (camera, exposure) in enumerate(
            zip(cameras, _exposures(len(cameras), options.exposure, k), strict=True)
        ):
            label = f"{name}_{index:03d}.jpg"
            rng = np.random.default_rng([options.seed, 4, k, index])
            image, coverage = picture(scene, camera, options.samples, rng)
            _write_frame(folder / name / label, developed(exposure * image, options.noise, rng),
                         exposure, options)  # fmt: skip
            if options.masks:
                (folder / "masks").mkdir(exist_ok=True)
                mask = np.where(coverage > 0.5, 255, 0).astype(np.uint8)
                write_png(folder / "masks" / f"{name}_{index:03d}.png", mask)
            frames.append(Frame(label, name, _in_world(camera, options.world), exposure))
            project.add_raster(label, folder / name / label, frames[-1].camera)

    # The truth
    lights = lights_record(scene, world, lambda points: _moved(points, options.world))
    write_truth(truth, scene, atlas, lights)
    if options.exposure:
        exposures = [{"label": f.label, "exposure": f.exposure} for f in frames]
        write_json(truth / "frames.json", {"frames": exposures})
    held_out = new_project()
    held_out.add_mesh("totem", folder / "totem.ply", matrix)
    for index, camera in enumerate(views):
        rng = np.random.default_rng([options.seed, 5, index])
        path = truth / "views" / f"view_{index:02d}.png"
        write_png(path, developed(picture(scene, camera, 4, rng)[0], 0.0, rng))
        held_out.add_raster(path.name, path, _in_world(camera, options.world))
    write_project(held_out, truth / "views" / "project.mlp")
    write_project(project, folder / "totem.mlp")
    return Totem(
        folder / "totem.mlp", scene, atlas, world, frames,
        [_in_world(view, options.world) for view in views],
    )  # fmt: skip


def placed(offset: tuple[float, float, float], scale: float = 1.0) -> np.ndarray:
    """A world where the object lies at `offset`, `scale` large and with +Z up, (4, 4)."""
    world = np.eye(4)
    world[:3, :3] = scale * np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    world[:3, 3] = offset
    return world


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _in_world(camera: Camera, world: np.ndarray) -> Camera:
    """The camera in the world: rotated with it, at the scaled distance."""
    scale = np.cbrt(np.linalg.det(world[:3, :3]))
    R = camera.R @ (world[:3, :3] / scale).T
    return replace(camera, R=R, t=scale * camera.t - R @ world[:3, 3])


def _exposures(frames: int, spread: float, k: int) -> np.ndarray:
    """An automatic exposure's slow drift, its median 1."""
    turn = 2 * np.pi * np.arange(frames) / frames
    drift = np.sin(2 * turn + k) + 0.4 * np.sin(5 * turn + 2 * k)
    return np.exp(spread * (drift - np.median(drift)))


def _write_frame(path: Path, image: np.ndarray, exposure: float, options: Options) -> None:
    exif = Image.Exif()
    if options.exif:
        tags = exif.get_ifd(ExifTags.IFD.Exif)
        tags[ExifTags.Base.ExposureTime] = IFDRational(round(1e6 * exposure / 50), 1_000_000)
        tags[ExifTags.Base.FNumber] = IFDRational(56, 10)
        tags[ExifTags.Base.ISOSpeedRatings] = 200
    Image.fromarray(image).save(path, quality=options.quality, optimize=True, exif=exif)


def main(
    out: Annotated[Path, typer.Option(help="A new folder.")],
    frames: int = Options.frames,
    width: int = Options.width,
    height: int = Options.height,
    samples: int = Options.samples,
    columns: int = Options.columns,
    texture: int = Options.texture,
    orbits: int = Options.orbits,
    near: bool = Options.near,
    noise: float = Options.noise,
    clipped: float = Options.clipped,
    exposure: float = Options.exposure,
    exif: bool = Options.exif,
    masks: bool = Options.masks,
    uv: bool = Options.uv,
    offset: Annotated[float, typer.Option(help="Distance from the origin along all axes.")] = 0.0,
    layer_matrix: bool = Options.layer_matrix,
    seed: int = Options.seed,
) -> None:
    """Make the sample project, or a variant of it."""
    world = placed((offset,) * 3) if offset else np.eye(4)
    options = Options(
        frames=frames, width=width, height=height, samples=samples, columns=columns,
        texture=texture, orbits=orbits, near=near, noise=noise, clipped=clipped,
        exposure=exposure, exif=exif, masks=masks, uv=uv, world=world,
        layer_matrix=layer_matrix, seed=seed,
    )  # fmt: skip
    print(make_totem(out, options).path)


if __name__ == "__main__":
    typer.run(main)
