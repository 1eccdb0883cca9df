"""Cameras from other programs: what their readers give, whatever the format.

colmap.py      a COLMAP model, text or binary
bundler.py     Bundler's bundle.out
metashape.py   Metashape's cameras.xml
camera_json.py our own cameras.json, and the rasters of another MeshLab project

`read_reconstruction` finds the reader.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera
from ..geometry.lens import Lens

ROTATION_TOLERANCE = 1e-4  # six written digits leave 1e-6


@dataclass(frozen=True)
class ForeignCamera:
    """A camera as another program knows it, in that program's world.

    name : of its image, with folders where the program has them
    lens : size, focal length, distortion, as of the frame that it saw
    R, t : (3, 3), (3,) float64, world to camera in OpenCV's axes
    """

    name: str
    lens: Lens
    R: np.ndarray
    t: np.ndarray

    def pinhole(self) -> Camera:
        """The camera of the undistorted frame."""
        return self.lens.pinhole(self.R, self.t)


@dataclass(frozen=True)
class Reconstruction:
    """path : where it was read; cameras : in the file's order; points : (N, 3) of the object."""

    path: Path
    cameras: list[ForeignCamera]
    points: np.ndarray = dataclass_field(default_factory=lambda: np.zeros((0, 3)))


Sizes = Callable[[str], tuple[int, int] | None]
"""Width and height of the image of a name, where the format does not tell; None: not known."""


def read_reconstruction(path: Path, sizes: Sizes = lambda name: None) -> Reconstruction:
    """Cameras from a file or folder of another program.

    Raises
    ------
    DocumentError : no such file, no known format, or a damaged file: the place is named.
    """
    from . import bundler, camera_json, colmap, metashape

    suffix = path.suffix.lower()
    if colmap.is_model(path):
        found = colmap.read_model(path)
    elif path.is_dir():
        raise DocumentError(
            f"{path}: expected the folder of a COLMAP model (cameras and images, .txt or .bin)"
        )
    elif not path.is_file():
        raise DocumentError(f"{path}: does not exist; give the file or folder of the cameras")
    elif suffix == ".out":
        found = bundler.read_bundle(path, sizes)
    elif suffix == ".xml":
        found = metashape.read_cameras(path)
    elif suffix == ".json":
        found = camera_json.read_cameras(path)
    elif suffix in (".mlp", ".mlb"):
        found = camera_json.read_rasters(path)
    else:
        raise DocumentError(
            f"{path}: expected a COLMAP folder, Bundler's .out, Metashape's .xml, a cameras .json "
            "or a MeshLab project .mlp"
        )
    if not found.cameras:
        raise DocumentError(f"{path}: holds no registered camera; give the file of another run")
    return found


def checked_pose(R: np.ndarray, t: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """R and t as float64, if they are finite and R is a rotation."""
    R, t = np.asarray(R, np.float64), np.asarray(t, np.float64)
    if not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise DocumentError(f"{where}: the pose is not finite; export the cameras again")
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise DocumentError(f"{where}: expected a rotation, found {R.tolist()}")
    return R, t


def checked_lens(lens: Lens, where: str) -> Lens:
    """The lens, if it has pixels and a focal length, and does not fold the frame over itself."""
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.coefficients)
    if lens.width < 1 or lens.height < 1 or not np.isfinite(numbers).all():
        raise DocumentError(
            f"{where}: expected pixels and finite numbers, found {lens.width}×{lens.height} "
            f"and {numbers}"
        )
    if not (lens.fx > 0 and lens.fy > 0):
        raise DocumentError(f"{where}: the focal length is {lens.fx:g}, expected > 0 pixels")
    try:
        lens.pinhole()
    except ValueError as error:
        raise DocumentError(f"{where}: {error}; calibrate the lens again") from None
    return lens


def quaternion_matrix(q: np.ndarray, where: str) -> np.ndarray:
    """The rotation of a quaternion w, x, y, z."""
    length = float(np.linalg.norm(q))
    if not np.isfinite(length) or abs(length - 1) > 1e-3:
        raise DocumentError(f"{where}: expected a unit quaternion, found {list(map(float, q))}")
    w, x, y, z = np.asarray(q, np.float64) / length
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def read_text(path: Path) -> str:
    """A text file, or DocumentError where it is none."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: cannot be read as text ({error})") from None
