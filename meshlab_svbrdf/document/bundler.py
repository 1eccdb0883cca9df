"""Bundler's bundle.out, version 0.3.

Its cameras look along −z with y up, and its pixels count from the picture's middle, upwards:

    P = R X + t;  p = −P / P.z;  pixel = f (1 + k1 |p|² + k2 |p|⁴) p

It tells neither names nor sizes: names are the lines of list.txt beside it, sizes the images'.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.lens import Lens
from .reconstruction import (
    ForeignCamera,
    Reconstruction,
    Sizes,
    checked_lens,
    checked_pose,
    read_text,
)

HEADER = "# Bundle file"
FLIP = np.diag([1.0, -1.0, -1.0])


def read_bundle(path: Path, sizes: Sizes) -> Reconstruction:
    """Cameras and points; cameras that Bundler did not register (f = 0) are left out.

    Raises
    ------
    DocumentError : the file is damaged or cut off, list.txt or an image's size is missing.
    """
    numbers = _Numbers(path)
    cameras, points = numbers.counts()
    names = _names(path, cameras)
    found = []
    for index in range(cameras):
        where = f"{path}: camera {index} ({names[index]})"
        f, k1, k2 = numbers.take(3, where)
        R, t = numbers.take(9, where).reshape(3, 3), numbers.take(3, where)
        if f == 0:
            continue
        size = sizes(names[index])
        if size is None:
            raise DocumentError(
                f"{where}: its image is not among the frames, and Bundler does not tell its size; "
                "give the folder of the images"
            )
        R, t = checked_pose(R, t, where)
        width, height = size
        lens = Lens(width, height, f, f, (width - 1) / 2, (height - 1) / 2, (k1, k2, 0.0, 0.0, 0.0))
        found.append(ForeignCamera(names[index], checked_lens(lens, where), FLIP @ R, FLIP @ t))
    cloud = []
    for index in range(points):
        where = f"{path}: point {index}"
        cloud.append(numbers.take(3, where))
        numbers.take(3, where)
        numbers.take(4 * numbers.count(where), where)
    return Reconstruction(path, found, np.array(cloud).reshape(-1, 3))


class _Numbers:
    """The numbers of the file, one after the other, however they are spread over lines."""

    def __init__(self, path: Path) -> None:
        self.path, self.at = path, 0
        first, _, rest = read_text(path).partition("\n")
        if not first.startswith(HEADER):
            raise DocumentError(f"{path}, line 1: expected {HEADER + ' v0.3'!r}, found {first!r}")
        self.words = rest.split()

    def counts(self) -> tuple[int, int]:
        where = f"{self.path}, line 2"
        cameras, points = self.take(2, where)
        return self._count(cameras, where), self._count(points, where)

    def count(self, where: str) -> int:
        """How many of something follow."""
        return self._count(self.take(1, where)[0], where)

    def _count(self, number: float, where: str) -> int:
        if not 0 <= number < 1e18 or number != int(number):
            raise DocumentError(f"{where}: expected a count, found {number:g}")
        return int(number)

    def take(self, count: int, where: str) -> np.ndarray:
        words = self.words[self.at : self.at + count]
        self.at += count
        if len(words) < count:
            raise DocumentError(f"{where}: the file is cut off; copy it again")
        try:
            return np.array([float(word) for word in words])
        except ValueError:
            raise DocumentError(f"{where}: expected {count} numbers, found {words[:4]}") from None


def _names(path: Path, count: int) -> list[str]:
    listed = next(
        (f for f in (path.with_name("list.txt"), path.with_suffix(".list.txt")) if f.is_file()),
        None,
    )
    if listed is None:
        raise DocumentError(
            f"{path}: list.txt, the names of its {count} images, is not beside it; put it there"
        )
    lines = [line.split() for line in read_text(listed).splitlines() if line.strip()]
    if len(lines) < count:
        raise DocumentError(
            f"{listed}: names {len(lines)} images, {path.name} has {count} cameras; give the list "
            "that Bundler was given"
        )
    return [words[0] for words in lines[:count]]
