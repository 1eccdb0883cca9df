"""COLMAP's sparse models: cameras, images and points3D, as text or binary.

COLMAP's cameras are OpenCV's, but for pixel centres, which lie at halves there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import DocumentError
from ..geometry.lens import Lens
from .reconstruction import (
    ForeignCamera,
    Reconstruction,
    checked_lens,
    checked_pose,
    quaternion_matrix,
    read_text,
)

FILES = ("cameras", "images")
# Each model's number in binary files, and what its parameters are
MODELS = {
    0: ("SIMPLE_PINHOLE", "f cx cy"),
    1: ("PINHOLE", "fx fy cx cy"),
    2: ("SIMPLE_RADIAL", "f cx cy k1"),
    3: ("RADIAL", "f cx cy k1 k2"),
    4: ("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    5: ("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    6: ("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    7: ("FOV", "fx fy cx cy omega"),
    8: ("SIMPLE_RADIAL_FISHEYE", "f cx cy k1"),
    9: ("RADIAL_FISHEYE", "f cx cy k1 k2"),
    10: ("THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
}
NAMES = {name: words.split() for name, words in MODELS.values()}
OTHER = ("OPENCV_FISHEYE", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE")


class _Image(NamedTuple):
    name: str
    camera: int
    q: np.ndarray
    t: np.ndarray
    where: str


def is_model(path: Path) -> bool:
    """Whether a folder holds a model."""
    return any(all((path / f"{n}{kind}").is_file() for n in FILES) for kind in (".bin", ".txt"))


def read_model(folder: Path) -> Reconstruction:
    """A model's cameras, sorted by name, and its points where points3D is there.

    Raises
    ------
    DocumentError : a file is damaged or cut off, or a camera model is not OpenCV's.
    """
    binary = all((folder / f"{name}.bin").is_file() for name in FILES)
    kind = ".bin" if binary else ".txt"
    cameras, images = folder / f"cameras{kind}", folder / f"images{kind}"
    lenses = dict(_binary_cameras(cameras) if binary else _text_cameras(cameras))
    found = []
    for image in _binary_images(images) if binary else _text_images(images):
        if image.camera not in lenses:
            raise DocumentError(
                f"{image.where}: camera {image.camera} is not in {cameras.name}; export both anew"
            )
        R, t = checked_pose(quaternion_matrix(image.q, image.where), image.t, image.where)
        found.append(ForeignCamera(image.name, lenses[image.camera], R, t))
    points = folder / f"points3D{kind}"
    cloud = (_binary_points if binary else _text_points)(points) if points.is_file() else None
    found.sort(key=lambda camera: camera.name)
    return Reconstruction(folder, found, np.zeros((0, 3)) if cloud is None else cloud)


def _lens(model: str, size: tuple[int, int], values: list[float], where: str) -> Lens:
    if model not in NAMES:
        raise DocumentError(f"{where}: unknown camera model {model!r}")
    if model in OTHER:
        raise DocumentError(
            f"{where}: camera model {model} is no lens of OpenCV's; undistort the images with "
            "`colmap image_undistorter` and give its model, whose cameras are PINHOLE"
        )
    names = NAMES[model]
    if len(values) != len(names):
        raise DocumentError(
            f"{where}: {model} has {len(names)} parameters, {len(values)} are there"
        )
    p = dict(zip(names, values, strict=True))
    if any(p.get(name) for name in ("k4", "k5", "k6")):
        raise DocumentError(
            f"{where}: k4, k5 and k6 of FULL_OPENCV are not known here; undistort the images with "
            "`colmap image_undistorter`, or use model OPENCV"
        )
    lens = Lens(
        *size, p.get("fx", p.get("f", 0.0)), p.get("fy", p.get("f", 0.0)),
        p["cx"] - 0.5, p["cy"] - 0.5,
        (p.get("k1", 0.0), p.get("k2", 0.0), p.get("p1", 0.0), p.get("p2", 0.0), p.get("k3", 0.0)),
    )  # fmt: skip
    return checked_lens(lens, where)


# Text


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Place and words of each line that is no comment."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.startswith("#"):
            yield f"{path}, line {number}", line.split()


def _text_cameras(path: Path) -> Iterator[tuple[int, Lens]]:
    for where, words in _lines(path):
        if not words:
            continue
        try:
            number, model, width, height, *values = words
            size = int(width), int(height)
            parameters = [float(value) for value in values]
            yield int(number), _lens(model, size, parameters, where)
        except ValueError:
            raise DocumentError(
                f"{where}: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS, "
                f"found {' '.join(words)[:60]!r}"
            ) from None


def _text_images(path: Path) -> Iterator[_Image]:
    """Every other line: the one after an image holds its points, and may be empty."""
    lines = _lines(path)
    for where, words in lines:
        if not words:
            continue
        try:
            numbers = np.array([float(word) for word in words[1:8]])
            if len(numbers) != 7 or len(words) < 10:
                raise ValueError
            image = _Image(" ".join(words[9:]), int(words[8]), numbers[:4], numbers[4:], where)
        except ValueError:
            raise DocumentError(
                f"{where}: expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, "
                f"found {' '.join(words)[:60]!r}"
            ) from None
        yield image
        next(lines, None)


def _text_points(path: Path) -> np.ndarray:
    found = []
    for where, words in _lines(path):
        if not words:
            continue
        try:
            x, y, z = (float(word) for word in words[1:4])
            found.append((x, y, z))
        except ValueError:
            raise DocumentError(
                f"{where}: expected POINT3D_ID X Y Z …, found {' '.join(words)[:60]!r}"
            ) from None
    return np.array(found).reshape(-1, 3)


# Binary


class _Bytes:
    """A file's bytes, taken one after the other."""

    def __init__(self, path: Path) -> None:
        self.path, self.at = path, 0
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise DocumentError(f"{path}: cannot be read ({error.strerror})") from None

    def take(self, form: str) -> tuple:
        form = "<" + form
        size = struct.calcsize(form)
        self._need(size)
        values = struct.unpack_from(form, self.data, self.at)
        self.at += size
        return values

    def skip(self, size: int) -> None:
        self._need(size)
        self.at += size

    def name(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            self._need(len(self.data))
        text, self.at = self.data[self.at : end], end + 1
        try:
            return text.decode("utf-8")
        except UnicodeDecodeError:
            raise DocumentError(f"{self.path}: byte {self.at}: expected a file name") from None

    def _need(self, size: int) -> None:
        if self.at + size > len(self.data):
            raise DocumentError(
                f"{self.path}: is cut off: {size} bytes are wanted from byte {self.at} on, the "
                f"file has {len(self.data)}; copy it again"
            )


def _binary_cameras(path: Path) -> Iterator[tuple[int, Lens]]:
    data = _Bytes(path)
    for _ in range(data.take("Q")[0]):
        where = f"{path}, byte {data.at}"
        number, model, width, height = data.take("IiQQ")
        if model not in MODELS:
            raise DocumentError(f"{where}: unknown camera model {model}")
        name, words = MODELS[model]
        values = list(data.take(f"{len(words.split())}d"))
        yield number, _lens(name, (width, height), values, f"{path}: camera {number}")


def _binary_images(path: Path) -> Iterator[_Image]:
    data = _Bytes(path)
    for _ in range(data.take("Q")[0]):
        number, *pose = data.take("I7d")
        (camera,) = data.take("I")
        name = data.name()
        data.skip(24 * data.take("Q")[0])
        where = f"{path}: image {number} ({name})"
        yield _Image(name, camera, np.array(pose[:4]), np.array(pose[4:]), where)


def _binary_points(path: Path) -> np.ndarray:
    data = _Bytes(path)
    found = []
    for _ in range(data.take("Q")[0]):
        _, x, y, z, *_ = data.take("Q3d3Bd")
        data.skip(8 * data.take("Q")[0])
        found.append((x, y, z))
    return np.array(found).reshape(-1, 3)
