"""MeshLab's VCGCamera element ↔ `Camera`, with every digit kept.

MeshLab stands at C, looks along −z, has y up and the image's origin at its bottom left corner,
pixel centres at halves; ours looks along +z, y down, origin at the centre of the top left pixel:

    R = diag(1, −1, −1) · Rot,  t = −R C,  C = −TranslationVector
    fx = F / sx,  fy = F / sy,  cx = CenterX − 1/2,  cy = H − CenterY − 1/2
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterable
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import DocumentError
from ..geometry.camera import Camera

FLIP = np.diag([1.0, -1.0, -1.0])
PIXEL_MM = 2.0**-7  # a power of two: square pixels' focal lengths come back to the last bit
COUNTS = {
    "FocalMm": (1,),
    "LensDistortion": (2, 4),
    "PixelSizeMm": (2,),
    "ViewportPx": (2,),
    "CenterPx": (2,),
    "RotationMatrix": (16,),
    "TranslationVector": (3, 4),  # raw 3, as text with a 1 behind
}
MOST_PIXELS = 1 << 30  # that OpenCV decodes
ROTATION_TOLERANCE = 1e-4  # six written digits leave 1e-6; 1e-4 moves no sample by a pixel


def read_camera(element: Element, where: str) -> Camera:
    """The camera of a VCGCamera element, text or base64 (`BinaryData="1"`).

    Parameters
    ----------
    element : the VCGCamera element
    where : names file and raster in errors

    Raises
    ------
    DocumentError
        An attribute is missing, has the wrong count of numbers or is not finite; the camera is not
        a perspective one, has lens distortion (MeshLab's forward and inverse distortion disagree),
        no focal length, no pixels, or a RotationMatrix that is not a rotation.
    """
    binary = element.get("BinaryData", "0").strip() == "1"

    def numbers(name: str) -> np.ndarray:
        text = element.get(name)
        if text is None:
            raise DocumentError(
                f"{where}: the camera has no {name}; MeshLab writes one: save again"
            )
        integer = name == "ViewportPx"
        return decode_numbers(
            text, COUNTS[name], f"{where}: {name}", binary=binary, integer=integer
        )

    # Refuse what a pinhole camera cannot say
    kind = element.get("CameraType", "0").strip()
    if kind != "0":
        raise DocumentError(
            f"{where}: CameraType is {kind!r}, expected 0 (perspective): orthographic views "
            "have no viewpoint to recover reflectance from; remove this raster"
        )
    if "LensDistortion" in element.attrib and numbers("LensDistortion").any():
        raise DocumentError(
            f"{where}: LensDistortion is {element.get('LensDistortion')!r}, expected '0 0': "
            "MeshLab's distortion is inconsistent; undistort the frames and write '0 0'"
        )

    width, height = (int(n) for n in numbers("ViewportPx"))
    focal = float(numbers("FocalMm")[0])
    sx, sy = numbers("PixelSizeMm")
    if not (width > 0 and height > 0 and focal > 0 and sx > 0 and sy > 0):
        raise DocumentError(
            f"{where}: the camera is not calibrated (ViewportPx {width} {height}, FocalMm {focal}, "
            f"PixelSizeMm {sx} {sy}, all expected > 0); register the frame or remove the raster"
        )
    if width * height > MOST_PIXELS:
        raise DocumentError(
            f"{where}: ViewportPx is {width} {height}, more pixels than any image has that can be "
            "read (2³⁰); write the frame's size"
        )
    center_x, center_y = numbers("CenterPx")

    # Turn MeshLab's axes into OpenCV's
    rotation = numbers("RotationMatrix").reshape(4, 4)
    _check_rotation(rotation, where)
    R = FLIP @ rotation[:3, :3]
    C = -numbers("TranslationVector")[:3]
    return Camera(
        width=width,
        height=height,
        fx=float(focal / sx),
        fy=float(focal / sy),
        cx=float(center_x - 0.5),
        cy=float(height - center_y - 0.5),
        R=R,
        t=-R @ C,
    )


def write_camera(
    element: Element, camera: Camera, *, binary: bool = False, told: Camera | None = None
) -> None:
    """Set the VCGCamera attributes of `element`, unless it says this camera already.

    told : the camera that it is known to say; None: it is read

    fx comes back exactly, and fy where pixels are square; else fy, cx, cy within one rounding.

    Raises
    ------
    DocumentError : `camera` would not be read back (not finite, no rotation, no focal length).
    """
    if "FocalMm" in element.attrib and same_camera(
        told or read_camera(element, "the camera"), camera
    ):
        _change_kind(element, binary)
        return
    rotation = np.eye(4)
    rotation[:3, :3] = FLIP @ camera.R
    pixel_mm = [PIXEL_MM, PIXEL_MM * (camera.fx / camera.fy)]
    values: dict[str, Iterable[float]] = {
        "FocalMm": [camera.fx * PIXEL_MM],
        "LensDistortion": [0.0, 0.0],
        "PixelSizeMm": pixel_mm,
        "CenterPx": [camera.cx + 0.5, camera.height - camera.cy - 0.5],
        "RotationMatrix": rotation.ravel(),
        "TranslationVector": [*(-camera.center), 1.0][: 3 if binary else 4],
    }
    written = {"CameraType": "0", "BinaryData": str(int(binary))}
    written["ViewportPx"] = encode_numbers([camera.width, camera.height], binary, integer=True)
    written |= {name: encode_numbers(value, binary) for name, value in values.items()}
    read_camera(Element("VCGCamera", written), "the camera to be written")
    element.attrib.update(written)


def _change_kind(element: Element, binary: bool) -> None:
    """Say the same numbers as text or base64; what is of that kind already keeps its characters."""
    was_binary = element.get("BinaryData", "0").strip() == "1"
    if was_binary == binary:
        return
    for name, counts in COUNTS.items():
        if name in element.attrib:
            integer = name == "ViewportPx"
            values = decode_numbers(
                element.attrib[name], counts, name, binary=was_binary, integer=integer
            )
            if name == "TranslationVector":
                values = values[:3] if binary else np.append(values[:3], 1.0)
            element.set(name, encode_numbers(values, binary, integer=integer))
    element.set("BinaryData", str(int(binary)))


def same_camera(a: Camera, b: Camera) -> bool:
    """Whether two cameras agree in every bit."""
    return a is b or all(np.array_equal(getattr(a, name), getattr(b, name)) for name in vars(a))


def decode_numbers(
    text: str,
    counts: tuple[int, ...],
    where: str,
    *,
    binary: bool = False,
    integer: bool = False,
) -> np.ndarray:
    """Numbers as MeshLab writes them: text, or base64 of raw little-endian scalars.

    Raw reals are doubles from PyMeshLab and floats from a single-precision MeshLab: the length
    tells. Raw integers have 4 bytes.

    Parameters
    ----------
    counts : how many there may be
    where : names file and place in errors

    Returns
    -------
    (count,) float64, or int64 if `integer`; all finite
    """
    expected = " or ".join(map(str, counts))
    shown = repr(text if len(text) <= 200 else f"{text[:200]}…")
    try:
        if binary:
            raw = base64.b64decode("".join(text.split()), validate=True)
            sizes = {count * 4: "<i4" if integer else "<f4" for count in counts}
            sizes |= {} if integer else {count * 8: "<f8" for count in counts}
            values = np.frombuffer(raw, sizes.get(len(raw), "V1"))
        else:
            kind = int if integer else float
            words = [kind(word) for word in text.split()]
            values = np.array(words, np.int64 if integer else np.float64)
    except (ValueError, binascii.Error, OverflowError) as error:
        raise DocumentError(f"{where}: expected {expected} numbers, found {shown}") from error
    if len(values) not in counts:
        raise DocumentError(f"{where}: expected {expected} numbers, found {shown}")
    values = values.astype(np.int64 if integer else np.float64)
    if not np.isfinite(values).all():
        raise DocumentError(f"{where}: expected finite numbers, found {shown}")
    return values


def encode_numbers(values: Iterable[float], binary: bool, *, integer: bool = False) -> str:
    """The inverse of `decode_numbers`: shortest exact decimals, or base64 of doubles (int32)."""
    if binary:
        raw = np.array(list(values), "<i4" if integer else "<f8").tobytes()
        return base64.b64encode(raw).decode("ascii")
    kind = int if integer else float
    return " ".join(repr(kind(value)) for value in values)


def _check_rotation(matrix: np.ndarray, where: str) -> None:
    R = matrix[:3, :3]
    error = np.abs(R @ R.T - np.eye(3)).max()
    pure = np.allclose(matrix[3], [0, 0, 0, 1], rtol=0, atol=1e-6) and not matrix[:3, 3].any()
    if error > ROTATION_TOLERANCE or np.linalg.det(R) < 0 or not pure:
        raise DocumentError(
            f"{where}: RotationMatrix is not a rotation (R Rᵀ differs from 1 by {error:.2g}, "
            f"determinant {np.linalg.det(R):.6g}); skew, scale or mirroring cannot be used"
        )
