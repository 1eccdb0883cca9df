"""Frames, masks and maps ↔ arrays: the raw pixel grid, rows from the top, channels R, G, B."""

from __future__ import annotations

import glob
import io
import re
from collections.abc import Sequence
from contextlib import redirect_stdout
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR

from ..errors import DocumentError
from .atomic import replacing

UDIM = re.compile(r"(.+)\.(1\d{3})")
"""The name, without its suffix, of a UDIM tile's image."""
_REDUCED_JPEG = {2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4}


def read_frame(
    path: str | Path,
    *,
    label: str | None = None,
    size: tuple[int, int] | None = None,
    reduce: int = 1,
) -> np.ndarray:
    """A photograph or video frame.

    EXIF orientation is ignored: cameras are made for the pixel grid as it is stored.

    Parameters
    ----------
    label : the raster's label, named in errors
    size : (width, height) of the raster's camera, which the frame must have
    reduce : 2 or 4: the means of so many pixels in both directions, as `reduced`; a JPEG is decoded
        at that size

    Returns
    -------
    (H, W, 3) uint8, sRGB; a grey image three times, alpha dropped

    Raises
    ------
    DocumentError : the file is missing, cut off, no image, not 8-bit, or of another size.
    """
    where = str(path) if label is None else f"raster {label!r}: {path}"
    data = read_bytes(path, where)
    if reduce > 1 and data.startswith(b"\xff\xd8"):
        flags = _REDUCED_JPEG[reduce] | cv2.IMREAD_IGNORE_ORIENTATION
        image = decoded(data, where, flags)
        small = None if size is None else (-(-size[0] // reduce), -(-size[1] // reduce))
        check_size(image, small, where)
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    # UNCHANGED also leaves EXIF orientation alone
    image = decoded(data, where, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint8:
        raise DocumentError(
            f"{where}: 8-bit sRGB expected, found {image.dtype}; convert the frame to 8 bits"
        )
    check_size(image, size, where)
    if image.ndim == 2:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    else:
        code = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
        image = cv2.cvtColor(image, code)
    return reduced(image, reduce)


def reduced(image: np.ndarray, times: int) -> np.ndarray:
    """The means of times × times pixels; the last ones of an odd size stand twice."""
    if times == 1:
        return image
    height, width = image.shape[:2]
    image = cv2.copyMakeBorder(
        image, 0, -height % times, 0, -width % times, cv2.BORDER_REPLICATE
    )  # fmt: skip
    return cv2.resize(image, None, fx=1 / times, fy=1 / times, interpolation=cv2.INTER_AREA)


def frame_problem(path: Path) -> str:
    """What a glance at the file tells against it, "" for nothing: the pixels are not decoded."""
    if not path.is_file():
        return "does not exist"
    if path.stat().st_size == 0:
        return "is empty"
    if cv2.haveImageReader(str(path)) or path.suffix.lower() == ".exr":
        return ""
    return "is not an image that OpenCV reads"


def read_mask(
    path: str | Path, *, label: str | None = None, size: tuple[int, int] | None = None
) -> np.ndarray:
    """A frame's mask, (H, W) bool: True (more than half of white) where the object is.

    Raises
    ------
    DocumentError
        The file is missing, cut off, no image, of another size, or holds small numbers (0 and 1)
        instead of 0 and 255.
    """
    where = str(path) if label is None else f"mask of raster {label!r}: {path}"
    image = _decode(path, where, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    check_size(image, size, where)
    mask = image > 127
    if image.any() and not mask.any():
        raise DocumentError(f"{where}: the mask's largest value is {image.max()}, 255 expected")
    return mask


def read_image(path: str | Path) -> np.ndarray:
    """Any image as it is stored: (H, W) or (H, W, 3 or 4), 8 or 16 bits, channels R, G, B(, A)."""
    image = _decode(path, str(path), cv2.IMREAD_UNCHANGED)
    return image if image.ndim == 2 else _swap_red_and_blue(image)


def png_of(array: np.ndarray) -> bytes:
    """An image as PNG.

    Parameters
    ----------
    array : (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), uint8 or uint16, channels R, G, B(, A)
    """
    array = np.asarray(array)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    shaped = array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))
    if not shaped or array.dtype not in (np.uint8, np.uint16) or array.size == 0:
        raise ValueError(
            "png_of expects (H, W) or (H, W, 1|3|4) of uint8 or uint16, found "
            f"{array.shape} of {array.dtype}; write np.round(255 * x).astype(np.uint8), x in [0, 1]"
        )
    _, data = cv2.imencode(".png", array if array.ndim == 2 else _swap_red_and_blue(array))
    return data.tobytes()


def jpeg_of(array: np.ndarray) -> bytes:
    """An image (H, W, 3) uint8, channels R, G, B, as a good JPEG."""
    how = [
        cv2.IMWRITE_JPEG_QUALITY, 95,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]  # fmt: skip
    _, data = cv2.imencode(".jpg", _swap_red_and_blue(array), how)
    return data.tobytes()


def write_png(path: str | Path, array: np.ndarray) -> None:
    """Write a PNG of `png_of`'s array whole or not at all."""
    data = png_of(array)
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_jpeg(path: str | Path, array: np.ndarray) -> None:
    """Write a JPEG of `jpeg_of`'s array whole or not at all."""
    data = jpeg_of(array)
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_exr(path: str | Path, array: np.ndarray) -> None:
    """Write an OpenEXR image of float32 (ZIP, lossless), whole or not at all; NaN stays NaN.

    Parameters
    ----------
    array : (H, W) or (H, W, 1), written as channel Y; or (H, W, 3), as R, G, B
    """
    array = np.ascontiguousarray(array, np.float32)
    if array.ndim == 3 and array.shape[2] == 1:
        array = np.ascontiguousarray(array[..., 0])
    if not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)) or array.size == 0:
        raise ValueError(f"write_exr expects (H, W), (H, W, 1) or (H, W, 3), found {array.shape}")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with replacing(path) as temporary:
        try:
            OpenEXR.File(header, {"Y" if array.ndim == 2 else "RGB": array}).write(str(temporary))
        except RuntimeError as error:  # how the library says that the disk is full
            raise OSError(str(error)) from None


def exr_header(path: str | Path) -> dict[str, Any]:
    """The attributes of an OpenEXR image, by name; DocumentError where it is none."""
    try:
        with (
            redirect_stdout(io.StringIO()),
            OpenEXR.File(str(path), separate_channels=True, header_only=True) as file,
        ):
            return dict(file.header())
    except Exception as error:  # the library raises RuntimeError, ValueError and its own
        raise DocumentError(f"{path}: cannot be read as OpenEXR ({error})") from error


def read_exr(path: str | Path) -> np.ndarray:
    """An OpenEXR image of one channel or of R, G, B: (H, W) or (H, W, 3) float32; alpha dropped.

    Raises
    ------
    DocumentError : the file is missing, no OpenEXR image, or has other channels.
    """
    if not Path(path).is_file():
        raise DocumentError(f"{path}: does not exist")
    try:
        # The library prints of damage, which its error tells
        said = redirect_stdout(io.StringIO())
        with said, OpenEXR.File(str(path), separate_channels=True) as file:
            pixels = {name: np.asarray(c.pixels, np.float32) for name, c in file.channels().items()}
    except Exception as error:  # the library raises RuntimeError, ValueError and its own
        raise DocumentError(f"{path}: cannot be read as OpenEXR ({error})") from error
    if {"R", "G", "B"} <= pixels.keys():
        return np.stack([pixels[name] for name in "RGB"], axis=-1)
    if len(pixels) == 1:
        return next(iter(pixels.values())).copy()
    raise DocumentError(
        f"{path}: expected channels R, G, B or a single one, found {sorted(pixels)}"
    )


def texture_files(path: Path, count: int, tiles: Sequence[int] = ()) -> list[Path]:
    """The images of `count` textures: NAME.png, NAME.1.png, NAME.2.png …

    tiles : numbers of the textures that are UDIM tiles: where `path` is one of NAME.1001.png,
        NAME.1002.png … they are these
    """
    tile = UDIM.fullmatch(path.stem)
    if tile and tiles:
        return [path.with_name(f"{tile[1]}.{number}{path.suffix}") for number in tiles]
    return [path] + [path.with_name(f"{path.stem}.{k}{path.suffix}") for k in range(1, count)]


def companions(path: Path) -> list[Path]:
    """All files that may be the images of an object's textures, where the given one is of one."""
    tile = UDIM.fullmatch(path.stem)
    if tile:
        beside = sorted(path.parent.glob(f"{glob.escape(tile[1])}.*{glob.escape(path.suffix)}"))
        return [file for file in beside if UDIM.fullmatch(file.stem)]
    return list(takewhile(Path.is_file, (texture_files(path, k + 1)[k] for k in count())))


def _decode(path: str | Path, where: str, flags: int) -> np.ndarray:
    return decoded(read_bytes(path, where), where, flags)


def read_bytes(path: str | Path, where: str) -> bytes:
    """An image file; DocumentError where it cannot be read, or is cut off."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise DocumentError(f"{where}: cannot be read ({error.strerror})") from error
    if _is_cut_off(data):
        raise DocumentError(f"{where}: the image is cut off; copy the file again")
    return data


def decoded(data: bytes, where: str, flags: int) -> np.ndarray:
    """An image as OpenCV has it; DocumentError where it is none."""
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        said = " ".join(str(error).split())
        raise DocumentError(f"{where}: cannot be decoded ({said})") from error
    if image is None:
        raise DocumentError(f"{where}: is not an image that OpenCV reads (JPEG, PNG, TIFF …)")
    return image


def _is_cut_off(data: bytes) -> bool:
    """Whether a JPEG or PNG ends early: decoders would fill the rest with grey and not say so."""
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data
    if not data.startswith(b"\xff\xd8"):
        return False
    # Step over the headers (their thumbnail has an end of its own) to the pixels
    at = 2
    while data[at : at + 1] == b"\xff" and data[at + 1 : at + 2] != b"\xda":
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return data.find(b"\xff\xd9", at) < 0


def check_size(image: np.ndarray, size: tuple[int, int] | None, where: str) -> None:
    """Refuse an image that has not the `size` (width, height) of its camera, if there is one."""
    height, width = image.shape[:2]
    if size is not None and (width, height) != tuple(size):
        raise DocumentError(
            f"{where}: has {width}×{height} pixels, its camera's ViewportPx says "
            f"{size[0]}×{size[1]}; use the frames that were registered"
        )


def _swap_red_and_blue(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)
