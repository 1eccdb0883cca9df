"""The exposure that a camera wrote into its photograph's EXIF."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image

from ..errors import DocumentError
from .deep_images import kind_of


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


def positive(value: Any) -> float | None:
    """A tag's number, its first one where it has several; None where it is no number above 0."""
    if isinstance(value, tuple) and value:
        value = value[0]
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if number > 0 and math.isfinite(number) else None
