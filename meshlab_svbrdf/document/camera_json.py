"""Cameras in a JSON file, and those of another MeshLab project.

    {"cameras": [{"image": "walk_000123.jpg", "width": 1920, "height": 1080,
                  "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "distortion": [k1, k2, p1, p2, k3],
                  "R": [[…], […], […]], "t": [x, y, z]}]}

OpenCV's convention: x ~ K (R X + t), y down, pixel centres at whole numbers. `distortion` may be
left out. "frames" or "views" may stand for "cameras", and "file" for "image".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera
from ..geometry.lens import Lens
from .project import read_project
from .reconstruction import ForeignCamera, Reconstruction, checked_lens, checked_pose
from .stored import read_json

LISTS = ("cameras", "frames", "views")


def read_cameras(path: Path) -> Reconstruction:
    """The cameras of the JSON file; `DocumentError` names the entry that is wrong."""
    content = read_json(path)
    name = next((n for n in LISTS if isinstance(content, dict) and n in content), None)
    if name is None or not isinstance(content[name], list):
        raise DocumentError(f'{path}: expected {{"cameras": [...]}}')
    found = [_camera(e, f"{path}: {name}[{k}]") for k, e in enumerate(content[name])]
    return Reconstruction(path, found)


def read_rasters(path: Path) -> Reconstruction:
    """The rasters of a MeshLab project."""
    rasters = read_project(path).rasters
    return Reconstruction(path, [from_pinhole(r.path.name, r.camera) for r in rasters])


def from_pinhole(name: str, camera: Camera) -> ForeignCamera:
    """A camera without distortion, by the name of its image."""
    c = camera
    return ForeignCamera(name, Lens(c.width, c.height, c.fx, c.fy, c.cx, c.cy), c.R, c.t)


def _camera(entry: Any, where: str) -> ForeignCamera:
    try:
        K = np.array(entry["K"], np.float64).reshape(3, 3)
        R, t = np.array(entry["R"], np.float64), np.array(entry["t"], np.float64)
        k = [float(value) for value in entry.get("distortion", ())]
        size = int(entry["width"]), int(entry["height"])
        name = str(entry["image"] if "image" in entry else entry["file"])
        if R.shape != (3, 3) or t.shape != (3,) or len(k) > 5:
            raise ValueError(f"R {R.shape}, t {t.shape}, {len(k)} coefficients of distortion")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DocumentError(
            f"{where}: expected image, width, height, K (3×3), R (3×3), t (3) and perhaps "
            f"distortion (at most 5), found {error!r}"
        ) from None
    if K[0, 1] or K[1, 0] or K[2, 0] or K[2, 1] or K[2, 2] != 1:
        raise DocumentError(f"{where}: expected K without skew, found {K.tolist()}")
    k += [0.0] * (5 - len(k))
    lens = Lens(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2], (k[0], k[1], k[2], k[3], k[4]))
    R, t = checked_pose(R, t, where)
    return ForeignCamera(name, checked_lens(lens, where), R, t)
