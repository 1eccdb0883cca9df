"""Images of more than 8 bits: PNG and TIFF of 16, OpenEXR, Radiance HDR and TIFF of floats.

kind_of       what the file's head tells: "8", "16" or "float"
read_values   its pixels as they are stored
as_seen       the same as 8-bit sRGB, for people and for what compares outlines
read_seen     a frame of any depth like that
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..errors import DocumentError
from ..samples.luminance import to_srgb8
from ..samples.radiance_code import LARGEST
from .images import check_size, decoded, read_bytes, read_exr, read_frame, reduced

EXR = b"\x76\x2f\x31\x01"
RADIANCE = (b"#?RADIANCE", b"#?RGBE")
PNG = b"\x89PNG"
TIFF = (b"II*\x00", b"MM\x00*")
HEAD = 32


def kind_of(path: Path) -> str:
    """ "8", "16" or "float"; "8" also where the file is missing or no image: its reader says so."""
    try:
        with open(path, "rb") as file:
            head = file.read(HEAD)
        if head.startswith((EXR, *RADIANCE)):
            return "float"
        if head.startswith(PNG):
            return "16" if head[24:25] == b"\x10" else "8"
        return _kind_of_tiff(path) if head.startswith(TIFF) else "8"
    except OSError:
        return "8"


def _kind_of_tiff(path: Path) -> str:
    from tifffile import TiffFile, TiffFileError  # few frames are TIFF

    try:
        with TiffFile(path) as file:
            kind = file.pages.first.dtype
    except TiffFileError:
        return "8"
    return "8" if kind is None or kind.itemsize == 1 else "16" if kind == "u2" else "float"


def is_exr(path: Path) -> bool:
    """Whether the file begins as OpenEXR does."""
    try:
        with open(path, "rb") as file:
            return file.read(len(EXR)) == EXR
    except OSError:
        return False


def read_values(
    path: Path, *, label: str | None = None, size: tuple[int, int] | None = None
) -> np.ndarray:
    """The pixels of a frame as they are stored.

    Parameters
    ----------
    label : the raster's label, named in errors
    size : (width, height) of the raster's camera, which the frame must have

    Returns
    -------
    (H, W, 3) uint8 or uint16, coded; or float32, linear light ≥ 0. A grey image three times, alpha
    dropped.

    Raises
    ------
    DocumentError : as `read_frame`; or floats that are no light: NaN, infinite, negative, too
        large.
    """
    where = str(path) if label is None else f"raster {label!r}: {path}"
    if is_exr(path):
        image = read_exr(path)
    else:
        image = decoded(read_bytes(path, where), where, cv2.IMREAD_UNCHANGED)
        if image.ndim == 3:
            code = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
            image = cv2.cvtColor(image.astype(np.float32) if image.dtype == "f8" else image, code)
    check_size(image, size, where)
    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, -1)
    if image.dtype.kind == "f":
        return _light(image.astype(np.float32), where)
    if image.dtype not in (np.uint8, np.uint16):
        raise DocumentError(f"{where}: 8 or 16 bits, or floats, expected, found {image.dtype}")
    return image


def _light(image: np.ndarray, where: str) -> np.ndarray:
    good = (image >= 0) & (image < LARGEST)
    if good.all():
        return image
    bad = ~good.all(-1)
    row, col = np.argwhere(bad)[0]
    found = ", ".join(f"{value:g}" for value in image[row, col])
    raise DocumentError(
        f"{where}: {bad.sum():,} pixels are no light (NaN, infinite, negative, or {LARGEST:.0f} "
        f"and more), the first in column {col}, row {row}: {found}. Set such pixels to 0 where "
        "they show nothing, or scale the frames down"
    )


def as_seen(values: np.ndarray, white: float | None = None) -> np.ndarray:
    """8-bit sRGB, (H, W, 3), of `read_values`' pixels: 16 bits are taken for sRGB.

    white : the light that is shown as white; None: the power of two above 99 % of the pixels
    """
    if values.dtype == np.uint8:
        return values
    if values.dtype == np.uint16:
        return ((values.astype(np.uint32) + 128) // 257).astype(np.uint8)
    if white is None:
        top = float(np.quantile(values.max(-1), 0.99))
        white = 2.0 ** np.ceil(np.log2(top)) if top > 0 else 1.0
    return to_srgb8(values / np.float32(white))


def read_seen(
    path: Path,
    *,
    label: str | None = None,
    size: tuple[int, int] | None = None,
    reduce: int = 1,
    white: float | None = None,
) -> np.ndarray:
    """A frame of any depth as 8-bit sRGB: `read_frame`, or `as_seen` of `read_values`."""
    if kind_of(path) == "8":
        return read_frame(path, label=label, size=size, reduce=reduce)
    return reduced(as_seen(read_values(path, label=label, size=size), white), reduce)
