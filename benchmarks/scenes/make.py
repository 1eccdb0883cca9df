"""Render scenes of the benchmark into a folder (by default the user's cache).

    python -m benchmarks.scenes.make [--scene NAME …] [--cache FOLDER]

A scene that is there already, made from the same declaration, is left as it is.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.geometry.camera import Camera
from sample_projects.make_totem import placed
from sample_projects.procedural.paint import encode_srgb

from .cameras import in_world, misregistered, orbits, views
from .catalogue import SCENES
from .paint import paint
from .shapes import make_shape
from .truth import write_json, write_truth
from .variant import Variant

VERSION = 2  # of the generator: change it when equal variants no longer give equal files
BACKGROUND = 0.136  # linear: a grey backdrop, 103 of 255
VIEW_SAMPLES = 48


def cache_folder() -> Path:
    """Where scenes are kept: SVBRDF_BENCHMARK_CACHE, or the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    chosen = os.environ.get("SVBRDF_BENCHMARK_CACHE")
    return Path(chosen) if chosen else Path(base) / "meshlab-svbrdf-benchmark"


def ensure_scene(variant: Variant, cache: Path) -> Path:
    """The scene's project, rendered if it is not in the cache: CACHE/NAME/NAME.mlp."""
    folder = cache / variant.name
    text = repr((VERSION, variant))
    digest = hashlib.sha256(text.encode()).hexdigest()
    stamp = folder / "digest.txt"
    if not stamp.is_file() or stamp.read_text() != digest:
        started = time.perf_counter()
        temporary = cache / f".{variant.name}.{os.getpid()}"
        try:
            make_scene(variant, temporary)
            (temporary / "digest.txt").write_text(digest)
            shutil.rmtree(folder, ignore_errors=True)
            temporary.rename(folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        print(f"{variant.name}: rendered in {time.perf_counter() - started:.0f} s", flush=True)
    return folder / f"{variant.name}.mlp"


def make_scene(variant: Variant, folder: Path) -> None:
    """Write mesh, frames, project and truth into a new folder."""
    from .renderer import Renderer

    (folder / "frames").mkdir(parents=True)
    truth = folder / "ground_truth"
    (truth / "views").mkdir(parents=True)
    mesh, scan = make_shape(variant.shape, variant.detail, variant.coarse, variant.seed)
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    maps = paint(mesh, variant)
    renderer = Renderer(mesh, maps, variant)
    world = _world(variant)

    # Render, and choose the exposure that clips the declared share. Threads add up in any order:
    # the renderings repeat to float32's last bits only
    cameras, held_out = orbits(variant, reach), views(variant, reach)
    images = [renderer.render(camera, variant.samples, 1 + k) for k, camera in enumerate(cameras)]
    brightest = np.concatenate([image.max(-1)[cover > 0.999] for image, cover in images])
    exposure = float(f"{1 / np.quantile(brightest, 1 - variant.clipped):.4g}")

    # Write what the camera recorded
    rng = np.random.default_rng([variant.seed, 6])
    drift = _drift(variant)
    labels = [f"frame_{k:04d}.jpg" for k in range(len(cameras))]
    for label, (image, cover), factor in zip(labels, images, drift, strict=True):
        code = 255 * encode_srgb(factor * _over_background(exposure * image, cover))
        code += variant.noise * rng.standard_normal(code.shape)
        _write_frame(folder / "frames" / label, code, factor, variant)
    recorded = misregistered(cameras, variant, reach) if variant.pose_error else cameras
    frames = {folder / "frames" / k: c for k, c in zip(labels, recorded, strict=True)}
    write_ply(folder / "mesh.ply", scan.transformed(world))
    _write_project(folder / f"{variant.name}.mlp", folder / "mesh.ply", world, frames)

    # Write the truth
    write_truth(truth, renderer, mesh, maps, exposure, world)
    shots = {}
    for k, camera in enumerate(held_out):
        image = _over_background(
            *_scaled(renderer.render(camera, VIEW_SAMPLES, 5000 + k), exposure)
        )
        path = truth / "views" / f"view_{k:02d}.png"
        write_exr(path.with_suffix(".exr"), image)
        write_png(path, np.round(255 * encode_srgb(image)).astype(np.uint8))
        shots[path] = camera
    _write_project(truth / "views" / "project.mlp", folder / "mesh.ply", world, shots)
    write_json(
        folder / "scene.json",
        {
            "variant": asdict(variant),
            "exposure": exposure,
            "relative_exposures": drift.tolist(),
            "triangles": [len(mesh.faces), len(scan.faces)],
        },
    )


def _world(variant: Variant) -> np.ndarray:
    world = placed((variant.offset,) * 3) if variant.z_up else np.eye(4)
    world[:3, 3] = variant.offset
    return world


def _scaled(shot: tuple[np.ndarray, np.ndarray], factor: float) -> tuple[np.ndarray, np.ndarray]:
    return factor * shot[0], shot[1]


def _over_background(image: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    return image + BACKGROUND * (1 - coverage[..., None])


def _drift(variant: Variant) -> np.ndarray:
    """An automatic exposure's slow changes, their median 1; (frames,)."""
    turn = 4 * np.pi * np.arange(variant.frames) / variant.frames
    drift = np.sin(2 * turn) + 0.4 * np.sin(5 * turn + 1)
    return np.exp(variant.exposure * (drift - np.median(drift)))


def _write_frame(path: Path, code: np.ndarray, factor: float, variant: Variant) -> None:
    exif = Image.Exif()
    if variant.exif:
        tags = exif.get_ifd(ExifTags.IFD.Exif)
        tags[ExifTags.Base.ExposureTime] = IFDRational(round(1e6 * factor / 50), 1_000_000)
        tags[ExifTags.Base.FNumber] = IFDRational(56, 10)
        tags[ExifTags.Base.ISOSpeedRatings] = 200
    image = np.clip(np.round(code), 0, 255).astype(np.uint8)
    Image.fromarray(image).save(path, quality=variant.quality, exif=exif)


def _write_project(path: Path, mesh: Path, world: np.ndarray, frames: dict[Path, Camera]) -> None:
    project = new_project()
    project.add_mesh(path.stem, mesh)
    for frame, camera in frames.items():
        project.add_raster(frame.name, frame, in_world(camera, world))
    write_project(project, path)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", action="append", choices=list(SCENES))
    parser.add_argument("--cache", type=Path, default=cache_folder())
    arguments = parser.parse_args()
    for name in arguments.scene or SCENES:
        print(ensure_scene(SCENES[name], arguments.cache))


if __name__ == "__main__":
    main()
