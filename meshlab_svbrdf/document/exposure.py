"""The exposure that a file tells: a photograph's EXIF, the header of an image of floats."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image

from ..errors import DocumentError
from .deep_images import RADIANCE, is_exr, kind_of
from .images import exr_header

_EXPOSURE = re.compile(rb"^EXPOSURE=(.*)$", re.MULTILINE)
HEADER = 8192  # bytes of a Radiance file that are searched for its end


def read_exposure(path: str | Path) -> float | None:
    """Relative exposure t·ISO/N² of a photograph, with the time t in seconds and the f-number N.

    Linear pixel values are proportional to radiance times this; only ratios between photographs of
    one camera mean anything.

    Returns
    -------
    float > 0, or None where a tag is missing, zero, infinite or no number, or in images of floats,
    which say nothing of it

    Raises
    ------
    DocumentError : the file does not exist or is no image.
    """
    if kind_of(Path(path)) == "float":
        return None
    try:
        # Pillow warns of broken tags, which count as missing here
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read as an image ({error})") from error
    time = positive(tags.get(ExifTags.Base.ExposureTime))
    f_number = positive(tags.get(ExifTags.Base.FNumber))
    iso = positive(tags.get(ExifTags.Base.ISOSpeedRatings))
    if time is None or f_number is None or iso is None:
        return None
    return positive(time * iso / f_number / f_number)


def told_exposure(path: Path, *, asked: bool = False) -> float | None:
    """`read_exposure`, or what the header of an image of floats tells.

    Radiance HDR: the product of its EXPOSURE lines, by which its pixels are multiplied as
    the format defines. OpenEXR: expTime · isoSpeed / aperture², only if `asked`, for nothing says
    whether its pixels have been divided by that. None where nothing is told.
    """
    if kind_of(path) != "float":
        return read_exposure(path)
    if is_exr(path):
        tags = exr_header(path) if asked else {}
        time, iso, stop = (positive(tags.get(k)) for k in ("expTime", "isoSpeed", "aperture"))
        if time is None or iso is None or stop is None:
            return None
        return positive(time * iso / stop / stop)
    with path.open("rb") as file:
        head = file.read(HEADER).partition(b"\n\n")[0]
    if not head.startswith(RADIANCE):
        return None
    factors = [positive(text) for text in _EXPOSURE.findall(head)]
    known = [factor for factor in factors if factor is not None]
    return positive(math.prod(known)) if known and len(known) == len(factors) else None


def positive(value: Any) -> float | None:
    """A tag's number, its first one where it has several; None where it is no number above 0."""
    if isinstance(value, tuple) and value:
        value = value[0]
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if number > 0 and math.isfinite(number) else None
