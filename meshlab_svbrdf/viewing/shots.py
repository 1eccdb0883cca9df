"""A frame as its camera saw it: where that stood, and the picture."""

from __future__ import annotations

from typing import Any

import cv2

from ..document.coding import Coding
from ..document.frames import Frames
from ..document.project import RasterEntry
from ..errors import SvbrdfError
from ..geometry.camera import Camera
from ..geometry.texels import Texels
from .scene import Scene

WIDEST = 1280
"""Pixels of a picture's longer side, as a page gets it."""
QUALITY = 88


def stand(scene: Scene, frame: int) -> dict[str, Any]:
    """A frame's camera, as JSON."""
    return lens(raster(scene, frame).camera, scene.texels)


def lens(shot: Camera, texels: Texels) -> dict[str, Any]:
    """A camera in the object's radii about its centre.

    eye : (3,); axes : right, up and back; half : (2,), tangents from the picture's middle to its
    right and upper border; middle : (2,), the middle's own, which lies off the axis where the
    principal point is not the picture's
    """
    right, down, ahead = shot.R.tolist()
    return {
        "eye": ((shot.center - texels.center) / texels.radius).tolist(),
        "axes": [right, [-x for x in down], [-x for x in ahead]],
        "half": [shot.width / 2 / shot.fx, shot.height / 2 / shot.fy],
        "middle": [
            ((shot.width - 1) / 2 - shot.cx) / shot.fx,
            -((shot.height - 1) / 2 - shot.cy) / shot.fy,
        ],
    }


def picture(scene: Scene, frame: int) -> bytes:
    """The frame as a JPEG, made smaller where it is large; DocumentError where it is not there."""
    wanted = raster(scene, frame)
    times = -(-max(wanted.camera.width, wanted.camera.height) // WIDEST)
    with Frames([wanted], Coding.told(scene.document.json("frames"))) as frames:
        image = frames.read(wanted, times)
    good, code = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert good
    return code.tobytes()


def raster(scene: Scene, frame: int) -> RasterEntry:
    """The project's raster of a frame that the samples are of."""
    scene.check_frame(frame)
    label = scene.frames[frame]
    for entry in scene.document.rasters:
        if entry.label == label:
            return entry
    raise SvbrdfError(f"the project has no raster {label!r} any more")
