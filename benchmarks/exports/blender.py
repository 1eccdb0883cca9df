"""Blender: the GLB as its importer opens it, lamps and all, rendered by Cycles, direct light.

Blender is a Python module, bpy, for one version of Python each: it runs in a process of its own,
by the interpreter that SVBRDF_BENCHMARK_BLENDER names, else this one. (JSON in, EXR out.)
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SAMPLES = 32
VARIABLE = "SVBRDF_BENCHMARK_BLENDER"


def python() -> str:
    return os.environ.get(VARIABLE) or sys.executable


def why_not() -> str:
    """Why there is no Blender here, or \"\"."""
    done = subprocess.run([python(), "-c", "import bpy"], capture_output=True, check=False)
    return f"{python()} has no bpy; {VARIABLE} may name one that has" if done.returncode else ""


def render(glb: Path, cameras: Sequence[Any], folder: Path) -> list[tuple[Any, Any]]:
    """Views (H, W, 3), linear on black, and coverage (H, W)."""
    import numpy as np
    import OpenEXR

    told = {
        "glb": str(glb),
        "views": [
            {
                "file": str(folder / f"view_{k}.exr"), "size": [c.width, c.height],
                "focal": [c.fx, c.fy], "middle": [c.cx, c.cy], "R": c.R.tolist(),
                "center": c.center.tolist(),
            }
            for k, c in enumerate(cameras)
        ],
    }  # fmt: skip
    subprocess.run(
        [python(), __file__], input=json.dumps(told), capture_output=True, text=True, check=True
    )
    found = []
    for view in told["views"]:
        image = OpenEXR.File(view["file"]).channels()["RGBA"].pixels.astype(np.float64)
        found.append((image[..., :3], image[..., 3]))
    return found


def _render_here(told: dict[str, Any]) -> None:
    """In Blender: import, and render every view."""
    import bpy
    from mathutils import Matrix

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(
        filepath=told["glb"], export_import_convert_lighting_mode="COMPAT"
    )  # lux as they are
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_direct = 0
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.film_transparent = True
    scene.render.threads_mode = "FIXED"
    scene.render.threads = len(os.sched_getaffinity(0))
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "32"
    data = bpy.data.cameras.new("view")
    camera = bpy.data.objects.new("view", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    turn = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0)))  # glTF's Y is Blender's Z
    for view in told["views"]:
        (width, height), (fx, fy), (cx, cy) = view["size"], view["focal"], view["middle"]
        scene.render.resolution_x, scene.render.resolution_y = width, height
        scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1, fx / fy
        data.sensor_fit, data.sensor_width = "HORIZONTAL", 36
        data.lens = 36 * fx / width
        data.shift_x = (width / 2 - (cx + 0.5)) / width
        data.shift_y = ((cy + 0.5) - height / 2) / width
        distance = sum(x * x for x in view["center"]) ** 0.5
        data.clip_start, data.clip_end = 1e-3 * (distance + 1), 1e2 * (distance + 1)
        right, down, forward = view["R"]
        axes = Matrix((right, [-x for x in down], [-x for x in forward])).transposed()
        pose = (turn @ axes).to_4x4()
        pose.translation = turn @ Matrix.Translation(view["center"]).translation
        camera.matrix_world = pose
        scene.render.filepath = view["file"]
        bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    _render_here(json.load(sys.stdin))
