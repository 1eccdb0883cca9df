"""The focal length in pixels that a camera wrote into a photograph's EXIF."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image

from ..errors import DocumentError
from .deep_images import kind_of
from .exposure import positive

FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm; "35 mm equivalent" is by the diagonal
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # FocalPlaneResolutionUnit


def read_focal_length(path: str | Path) -> float | None:
    """Pixels, from the 35 mm equivalent, else from the length in mm and the sensor's resolution.

    None where the tags are missing, zero or no numbers, and in images of floats, which have none.
    Cropped or upright copies of a photograph are not told: the sensor is taken to be seen whole.

    Raises
    ------
    DocumentError : the file does not exist or is no image.
    """
    if kind_of(Path(path)) == "float":
        return None
    try:
        with warnings.catch_warnings():  # Pillow's on broken tags, which count as missing
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
                size = image.size
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read as an image ({error})") from error
    equivalent = positive(tags.get(ExifTags.Base.FocalLengthIn35mmFilm))
    if equivalent is not None:
        return in_pixels(equivalent, size, FILM_DIAGONAL)
    focal = positive(tags.get(ExifTags.Base.FocalLength))
    density = positive(tags.get(ExifTags.Base.FocalPlaneXResolution))
    unit = MILLIMETRES.get(tags.get(ExifTags.Base.FocalPlaneResolutionUnit, 2))
    recorded = positive(tags.get(ExifTags.Base.ExifImageWidth))
    if focal is None or density is None or unit is None or recorded is None:
        return None
    return focal * density / unit * (max(size) / max(recorded, _tall(tags)))


def in_pixels(focal: float, size: tuple[int, int], diagonal: float) -> float:
    """A focal length in mm in pixels of a picture of that size, on a sensor of that diagonal."""
    return focal / diagonal * math.hypot(*size)


def _tall(tags: Any) -> float:
    return positive(tags.get(ExifTags.Base.ExifImageHeight)) or 0.0
