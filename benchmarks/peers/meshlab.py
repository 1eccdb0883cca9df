"""MeshLab's projection of the frames onto a texture, through PyMeshLab.

`compute_color_and_texture_from_active_rasters_projection` with its weights: the angle of sight, the
distance, how near image borders and silhouettes are, and the frames' masks where there are any. It
averages sRGB values. Two of its defaults are changed: the depth test's tolerance, .5 world units,
is one object of ours, so ours is taken; and holes are not filled. It needs an OpenGL context and
Qt's plugins, and aborts the process where they are missing: it gets a process of its own, under a
virtual display where there is none. Frames are handed over as PNG, as they are: it knows nothing of
exposures.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.images import read_image, read_mask, write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.samples.luminance import decode

from ..scenes.score import Scores
from .capture import Capture, write_maps

OCCLUSION = 0.02  # object radii, as compute_svbrdf_samples has it
PROJECTION = """
import json, pymeshlab, sys, time
project, image, parameters = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
started = time.perf_counter(), time.process_time()
meshes = pymeshlab.MeshSet()
meshes.load_project(project)
meshes.compute_color_and_texture_from_active_rasters_projection(**parameters)
ended = time.perf_counter(), time.process_time()
meshes.current_mesh().textures()[parameters["textname"]].save(image)
print(json.dumps({"seconds": ended[0] - started[0], "cpu_seconds": ended[1] - started[1]}))
"""


def run(capture: Capture, truth: Path, folder: Path) -> Scores:
    """Seconds: loading the project and projecting; writing the PNGs is not counted."""
    masked = any(raster.mask for raster in capture.rasters)
    project = _write_project(capture, folder / "input", masked)
    image = folder / "projected.png"
    cost = project_frames(project, image, capture.size, capture.mesh.radius, masked)
    shutil.rmtree(project.parent)
    rgba = read_image(image)
    diffuse = np.where(rgba[..., 3:] > 0, decode(rgba[..., :3] / 255), np.nan)
    write_maps(folder, diffuse.astype(np.float32))
    return {"seconds": cost["seconds"]}


def project_frames(
    project: Path, image: Path, size: int, radius: float, masked: bool = False
) -> Scores:
    """Project a project's frames onto a texture image; wall clock and CPU seconds, files read too.

    size : of the texture; radius : of the object; masked : whether frames have an alpha channel
    """
    parameters = {
        "textname": "projected.png", "texsize": size, "dorefill": False,
        "deptheta": OCCLUSION * radius, "useangle": True, "usedistance": True,
        "useborders": True, "usesilhouettes": True, "usealpha": masked,
    }  # fmt: skip
    return _project(project, image, parameters)


def why_not() -> str:
    """What this peer lacks on this machine, or \"\"."""
    if sys.platform != "linux":
        return ""
    if find_spec("PyQt5") is None:
        return "needs Qt's plugins: pip install 'meshlab-svbrdf[benchmark]'"
    if "DISPLAY" not in os.environ and shutil.which("xvfb-run") is None:
        return "needs a display: install xvfb"
    return ""


def _write_project(capture: Capture, folder: Path, masked: bool) -> Path:
    folder.mkdir(exist_ok=True)
    write_ply(folder / "mesh.ply", capture.mesh)
    project = new_project()
    project.add_mesh("object", folder / "mesh.ply")
    for k, raster in enumerate(capture.rasters):
        pixels = capture.frame(raster)
        if masked:
            size = raster.camera.width, raster.camera.height
            mask = (
                np.ones(pixels.shape[:2], bool)
                if raster.mask is None
                else read_mask(raster.mask, label=raster.label, size=size)
            )
            pixels = np.dstack([pixels, np.where(mask, 255, 0).astype(np.uint8)])
        path = folder / f"{k:05d}.png"
        write_png(path, pixels)
        project.add_raster(path.name, path, raster.camera)
    write_project(project, folder / "project.mlp")
    return folder / "project.mlp"


def _project(project: Path, image: Path, parameters: dict) -> Scores:
    environment = dict(os.environ)
    command = [sys.executable, "-c", PROJECTION, str(project), str(image), json.dumps(parameters)]
    if sys.platform == "linux":
        environment |= {"QT_QPA_PLATFORM": "xcb", "QT_PLUGIN_PATH": str(_qt_plugins())}
        if "DISPLAY" not in environment:
            if shutil.which("xvfb-run") is None:
                raise SvbrdfError("MeshLab's projection needs a display: install xvfb")
            command = ["xvfb-run", "-a", "-s", "-screen 0 1280x1024x24", *command]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode != 0 or not image.is_file():
        raise SvbrdfError(
            f"MeshLab's projection ended with {done.returncode}: {done.stderr.strip()[-500:]}"
        )
    return json.loads(done.stdout.strip().splitlines()[-1])


def _qt_plugins() -> Path:
    qt = find_spec("PyQt5")
    places = (
        [Path(place) / "Qt5" / "plugins" for place in qt.submodule_search_locations] if qt else []
    )
    if not any(place.is_dir() for place in places):
        raise SvbrdfError(
            "MeshLab's projection needs Qt's plugins: pip install 'meshlab-svbrdf[benchmark]'"
        )
    return places[0]
