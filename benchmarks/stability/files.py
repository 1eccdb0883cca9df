"""Good files of every format that the suite reads, small, and what reads them."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from meshlab_svbrdf.bench.files import write_video
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.exposure import read_exposure
from meshlab_svbrdf.document.focal_length import read_focal_length
from meshlab_svbrdf.document.images import (
    read_exr,
    read_frame,
    read_image,
    read_mask,
    write_exr,
    write_jpeg,
    write_png,
)
from meshlab_svbrdf.document.light_files import read_light_file
from meshlab_svbrdf.document.mesh_files import read_mesh, write_ply
from meshlab_svbrdf.document.picked_points import read_points
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.document.reconstruction import read_reconstruction
from meshlab_svbrdf.document.video import VideoReader
from meshlab_svbrdf.document.video_file import frame_times
from meshlab_svbrdf.document.video_names import read_videos
from meshlab_svbrdf.filter import Filter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.samples.chunks import SampledFrame
from meshlab_svbrdf.samples.store import SampleStore, write_store
from meshlab_svbrdf.script import check_script, read_script

SIZE = 32, 24


@dataclass(frozen=True)
class Format:
    """name : of the format; path : of a good file, to be damaged; text : whether it is text

    read : what the suite does with the file
    """

    name: str
    path: Path
    text: bool
    read: Callable[[Path], Any]


def formats(folder: Path) -> list[Format]:
    """Good files in an empty folder."""
    project = small_project(folder / "project")
    result = _result(project, folder / "result")
    found = [
        Format(".mlp", project, True, open_project),
        Format(".mlb", _as_mlb(project), True, open_project),
        Format("exact.mlp", result.with_suffix(".svbrdf") / "exact.mlp", True,
               lambda path: open_project(result)),
        Format("svbrdf.json", result.with_suffix(".svbrdf") / "svbrdf.json", True,
               lambda path: open_and_save(result)),
        Format("videos.json", _videos(folder), True, lambda path: read_videos(path.parent)),
        Format("a result's .npy", result.with_suffix(".svbrdf") / "texels" / "height.npy", False,
               lambda path: Document.open(result).attribute("height")),
        Format("a result's .json", result.with_suffix(".svbrdf") / "notes.json", True,
               lambda path: Document.open(result).json("notes")),
        Format(".mlx", _script(folder / "chain.mlx"), True, _read_script),
        Format(".ply, text", _text_ply(folder / "text.ply"), True, read_mesh),
        Format(".ply, binary", project.with_name("mesh.ply"), False, read_mesh),
        Format(".obj", _obj(folder), True, read_mesh),
        Format(".mtl", folder / "mesh.mtl", True, lambda path: read_mesh(path.with_suffix(".obj"))),
        Format("cameras .json", _cameras(folder / "cameras.json"), True, read_reconstruction),
        Format("lights .json", _lights(folder / "lights.json"), True, read_light_file),
        Format("points .json", _points(folder / "points.json"), True, read_points),
        Format("points .csv", _csv(folder / "points.csv"), True, read_points),
        Format("Bundler", _bundle(folder / "bundle"), True,
               lambda path: read_reconstruction(path, lambda name: SIZE)),
        Format("Metashape", _metashape(folder / "metashape.xml"), True, read_reconstruction),
        Format(".exr", _exr(folder / "map.exr"), False, read_exr),
        Format(".png", project.parent / "frames" / "f0.png", False, _read_picture),
        Format(".jpg", _jpeg(folder / "photo.jpg"), False, _read_photograph),
        *_samples(folder / "samples"),
        Format("video", _video(folder / "film.mp4"), False, _read_video),
    ]  # fmt: skip
    for kind in ("text", "binary"):
        model = _colmap(folder / f"colmap_{kind}", kind == "text")
        for name in ("cameras", "images", "points3D"):
            path = model / f"{name}{'.txt' if kind == 'text' else '.bin'}"
            found.append(
                Format(f"COLMAP {path.name}", path, kind == "text",
                       lambda path: read_reconstruction(path.parent))
            )  # fmt: skip
    return found


def small_project(folder: Path) -> Path:
    """FOLDER/small.mlp: a tetrahedron and three frames."""
    (folder / "frames").mkdir(parents=True)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    corner = np.array([[0.05, 0.05], [0.45, 0.05], [0.05, 0.45]])
    offset = np.array([[0, 0], [0.5, 0], [0, 0.5], [0.5, 0.5]])
    write_ply(folder / "mesh.ply", Mesh(vertices, faces, uv=corner[None] + offset[:, None]))
    project = new_project()
    project.add_mesh("stone", folder / "mesh.ply")
    rng = np.random.default_rng(0)
    for k in range(3):
        path = folder / "frames" / f"f{k}.png"
        write_png(path, rng.integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8))
        camera = Camera(*SIZE, 40.0, 40.0, 15.5, 11.5, np.eye(3), np.array([0.1 * k, 0, 4]))
        project.add_raster(path.name, path, camera, exposure=1.0)
    write_project(project, folder / "small.mlp")
    return folder / "small.mlp"


def open_project(path: Path) -> Document:
    """What every command does first, and the look at meshes and frames."""
    document = Document.open(path)
    document.mesh()
    for raster in document.rasters:
        if raster.path.is_file():
            size = raster.camera.width, raster.camera.height
            read_frame(raster.path, label=raster.label, size=size)
    return document


def open_and_save(path: Path) -> None:
    document = Document.open(path)
    document.settings.get("object")
    document.rasters, document.held_out  # noqa: B018
    for product in document.results.record["products"]:
        document.stale(product)
    document.save()


def _as_mlb(project: Path) -> Path:
    path = project.with_suffix(".mlb")
    write_project(Document.open(project).project, path)
    return path


def _result(project: Path, folder: Path) -> Path:
    """A saved result with an attribute, a map, a layer and JSON, made by a filter of one's own."""

    def apply(document, parameters, progress):
        from meshlab_svbrdf.geometry.texels import rasterise_texels

        texels = rasterise_texels(document.mesh(), ((16, 16),))
        document.set_texels(texels)
        height = texels.position[:, 2]
        document.set_attribute("height", height)
        document.set_map("height", texels.to_images(height))
        document.set_json("notes", {"list": [1, 2.5, None], "text": "height"})
        return "made"

    document = Document.open(project, folder)
    made = Filter("compute_demo", "Demo", ("mesh", "rasters"), ("demo",), apply=apply)
    document.apply(made)
    document.save()
    return document.path


def _videos(folder: Path) -> Path:
    path = folder / "film.svbrdf" / "frames" / "videos.json"
    path.parent.mkdir(parents=True)
    lens = {"width": 32, "height": 24, "fx": 40.0, "fy": 40.0, "cx": 15.5, "cy": 11.5}
    lens["coefficients"] = [-0.1, 0.02, 0.0, 0.0, 0.0]
    frames = {f"film_{k:06d}.jpg": {"index": k, "time": 0.04 * k} for k in range(2)}
    video = {"file": "../../film.mp4", "lens": lens, "frames": frames}
    path.write_text(json.dumps({"format": 1, "videos": [video]}))
    return path


def _script(path: Path) -> Path:
    path.write_text(
        '<!DOCTYPE FilterScript>\n<FilterScript>\n <filter name="compute_svbrdf_texels">\n'
        '  <Param name="texture_size" type="RichInt" value="256"/>\n </filter>\n'
        ' <filter name="compute_svbrdf_samples">\n  <Param name="step" value="4"/>\n'
        '  <Param name="memory" value="512"/>\n </filter>\n</FilterScript>\n'
    )
    return path


def _read_script(path: Path) -> None:
    check_script(read_script(path))


def _text_ply(path: Path) -> Path:
    path.write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nproperty list uchar float more\nelement face 2\n"
        "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
        "property int texnumber\nend_header\n0 0 0 1 2 3 1 5\n1 0 0 4 5 6 1 6\n0 1 0 7 8 9 1 7\n"
        "0 0 1 1 1 1 1 8\n3 0 1 2 6 0 0 1 0 0 1 0\n3 0 1 3 6 0 0 1 0 0 1 0\n"
    )
    return path


def _obj(folder: Path) -> Path:
    (folder / "mesh.obj").write_text(
        "mtllib mesh.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n"
        "usemtl one\nf 1/1/1 2/2/1 3/3/1\nf 1/1/1 2/2/1 -1/3/1\n"
    )
    (folder / "mesh.mtl").write_text("newmtl one\nKd 1 1 1\nmap_Kd -s 1 1 1 a.png\n")
    return folder / "mesh.obj"


def _cameras(path: Path) -> Path:
    camera = {
        "image": "a.jpg", "width": 32, "height": 24, "K": [[40, 0, 15.5], [0, 40, 11.5], [0, 0, 1]],
        "distortion": [-0.1, 0.02], "R": np.eye(3).tolist(), "t": [0, 0, 4],
    }  # fmt: skip
    path.write_text(json.dumps({"cameras": [camera, camera | {"image": "b.jpg"}]}))
    return path


def _lights(path: Path) -> Path:
    light = {"direction": [0, 1, 0], "position": None, "gain": 1.5, "color": [1, 0.9, 0.8]}
    path.write_text(json.dumps({"lights": [light, light], "ambient": [0.1, 0.1, 0.1]}))
    return path


def _points(path: Path) -> Path:
    points = [{"world": [0.1 * k, 1, 2], "pixel": [k, 2 * k]} for k in range(4)]
    path.write_text(json.dumps({"frames": [{"frame": "f0.png", "points": points}]}))
    return path


def _csv(path: Path) -> Path:
    path.write_text("# frame: f0.png\n0.1, 1.3, 0.4, 12.5, 4\n0.2, 1.3, 0.4, 13.5, 5\n")
    return path


def _bundle(folder: Path) -> Path:
    folder.mkdir()
    (folder / "list.txt").write_text("a.jpg\nb.jpg\n")
    camera = "40 -0.1 0.02\n1 0 0\n0 1 0\n0 0 1\n0 0 -4\n"
    (folder / "bundle.out").write_text(
        f"# Bundle file v0.3\n2 1\n{camera}{camera}1 2 3\n255 0 0\n1 0 12 3.5 4.5\n"
    )
    return folder / "bundle.out"


def _metashape(path: Path) -> Path:
    matrix = " ".join(map(str, np.eye(4).ravel()))
    path.write_text(
        '<?xml version="1.0"?><document version="1.4.0"><chunk><sensors><sensor id="0" '
        'type="frame"><calibration type="frame" class="adjusted"><resolution width="32" '
        'height="24"/><f>40</f><cx>0.5</cx><k1>-0.1</k1></calibration></sensor></sensors>'
        f'<cameras><camera id="0" label="a" sensor_id="0"><transform>{matrix}</transform></camera>'
        "</cameras><transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>1 2 3"
        "</translation><scale>2.5</scale></transform></chunk></document>"
    )
    return path


def _colmap(folder: Path, text: bool) -> Path:
    folder.mkdir()
    if text:
        (folder / "cameras.txt").write_text("# Cameras\n3 OPENCV 32 24 40 40 16 12 -0.1 0 0 0\n")
        (folder / "images.txt").write_text("1 1 0 0 0 0 0 4 3 a.jpg\n1.5 2.5 -1\n")
        (folder / "points3D.txt").write_text("7 1.0 2.0 3.0 0 0 0 0.5 1 0\n")
        return folder
    camera = struct.pack("<QIiQQ8d", 1, 3, 4, 32, 24, 40, 40, 16, 12, -0.1, 0, 0, 0)
    (folder / "cameras.bin").write_bytes(camera)
    image = struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 4, 3) + b"a.jpg\0"
    (folder / "images.bin").write_bytes(image + struct.pack("<Qddq", 1, 1.5, 2.5, -1))
    point = struct.pack("<QQ3d3BdQII", 1, 7, 1.0, 2.0, 3.0, 0, 0, 0, 0.5, 1, 1, 0)
    (folder / "points3D.bin").write_bytes(point)
    return folder


def _samples(folder: Path) -> list[Format]:
    """A sample store of three frames."""
    rng = np.random.default_rng(0)
    frames = [SampledFrame(np.arange(k, 40, 2, dtype=np.int32),
                           rng.integers(0, 256, (20 - k // 2, 4)).astype(np.uint8))
              for k in (0, 1, 2)]  # fmt: skip
    folder.mkdir()
    write_store(folder, 40, 3, lambda k: frames[k], names=["a", "b", "c"])

    def read(path: Path) -> None:
        store = SampleStore.open(path.parent)
        for block in store.blocks(16):
            block.frame, block.value  # noqa: B018
        store.map_texels(lambda block, own: block.value.sum(), np.arange(0, store.texels, 3))

    return [
        Format(f"samples, {path.name}", path, path.suffix == ".json", read)
        for path in sorted(folder.iterdir())
    ]


def _exr(path: Path) -> Path:
    write_exr(path, np.random.default_rng(0).random((8, 12, 3), np.float32))
    return path


def _jpeg(path: Path) -> Path:
    pixels = np.random.default_rng(0).integers(0, 256, (24, 32, 3)).astype(np.uint8)
    write_jpeg(path, pixels)
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 8.0, 0x8827: 100, 0xA405: 35})
    with Image.open(path) as image:
        image.load()
        image.save(path, exif=exif, quality=95)
    return path


def _read_picture(path: Path) -> None:
    read_frame(path, label="f0.png", size=SIZE)
    read_mask(path)
    read_image(path)


def _read_photograph(path: Path) -> None:
    read_exposure(path)
    read_focal_length(path)
    read_frame(path, label="photo.jpg", size=SIZE)
    read_frame(path, label="photo.jpg", size=SIZE, reduce=2)


def _video(path: Path) -> Path:
    rng = np.random.default_rng(0)
    write_video(path, list(rng.integers(0, 256, (4, 24, 32, 3)).astype(np.uint8)))
    return path


def _read_video(path: Path) -> None:
    times = list(frame_times(path))
    reader = VideoReader(path, times)
    try:
        for time in times[:4]:
            reader.read(time)
    finally:
        reader.close()


def restore(original: Path, kept: Path) -> None:
    """Put a folder back as it was."""
    shutil.rmtree(original)
    shutil.copytree(kept, original)
