"""Metashape's (PhotoScan's) cameras.xml.

Its cameras look along +z with y down, as OpenCV's; a camera's `transform` leads from the camera to
the chunk, the chunk's (or component's) rotation, translation and scale from there to the world. Its
principal point is an offset from the picture's middle, its P1 is OpenCV's p2 and its P2 p1.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from ..errors import DocumentError
from ..geometry.lens import Lens
from .project_xml import parse_plain
from .reconstruction import ForeignCamera, Reconstruction, checked_lens, checked_pose

SKEW = 0.1  # pixels at the picture's rim that b2 may move, and not be refused


def read_cameras(path: Path) -> Reconstruction:
    """The aligned cameras of the first chunk, in the world of the chunk.

    Raises
    ------
    DocumentError : no such XML, numbers are missing, or a lens is not OpenCV's.
    """
    root = parse_plain(path)
    chunk = root.find("chunk")
    if root.tag != "document" or chunk is None:
        raise DocumentError(f"{path}: expected Metashape's <document> with a <chunk>")
    lenses = {sensor.get("id", ""): sensor for sensor in chunk.iterfind("sensors/sensor")}
    worlds = {
        part.get("id", ""): _world(part, f"{path}: component {part.get('id')}")
        for part in chunk.iterfind("components/component")
    }
    whole = _world(chunk, f"{path}: chunk")
    found = []
    for camera in chunk.iterfind("cameras//camera"):
        label = camera.get("label", "")
        where = f"{path}: camera {label!r}"
        placed, enabled = camera.find("transform"), camera.get("enabled", "1").lower()
        if placed is None or enabled in ("0", "false"):
            continue
        sensor = lenses.get(camera.get("sensor_id", ""))
        if sensor is None:
            raise DocumentError(f"{where}: its sensor is not there; export the cameras again")
        s, R, T = worlds.get(camera.get("component_id", ""), whole)
        matrix = _numbers(placed, 16, where).reshape(4, 4)
        R_camera, center = checked_pose(matrix[:3, :3], matrix[:3, 3], where)
        R_world, C = (R @ R_camera).T, s * R @ center + T
        lens = _lens(sensor, f"{where}, sensor {sensor.get('id')}")
        found.append(ForeignCamera(label, lens, R_world, -R_world @ C))
    return Reconstruction(path, found)


def _world(part: ET.Element, where: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation and translation to the world; what is not there is none."""
    rotation, translation, scale = (
        part.find(f"transform/{name}") for name in ("rotation", "translation", "scale")
    )
    R = np.eye(3) if rotation is None else _numbers(rotation, 9, where).reshape(3, 3)
    T = np.zeros(3) if translation is None else _numbers(translation, 3, where)
    s = 1.0 if scale is None else float(_numbers(scale, 1, where)[0])
    if not s > 0:
        raise DocumentError(f"{where}: the scale is {s:g}, expected > 0")
    return s, *checked_pose(R, T, where)


def _lens(sensor: ET.Element, where: str) -> Lens:
    if sensor.get("type", "frame") != "frame":
        raise DocumentError(
            f"{where}: is of type {sensor.get('type')!r}, expected frame: export undistorted "
            "photos and their cameras"
        )
    calibrations = sensor.findall("calibration")
    adjusted = [c for c in calibrations if c.get("class", "adjusted") == "adjusted"]
    if not calibrations:
        raise DocumentError(f"{where}: has no calibration; align the photos first")
    calibration = (adjusted or calibrations)[0]
    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size

    def number(name: str, default: float | None = 0.0) -> float:
        element = calibration.find(name)
        if element is not None:
            return float(_numbers(element, 1, where)[0])
        if default is None:
            raise DocumentError(f"{where}: has no {name}; export the cameras again")
        return default

    try:
        width, height = (int(size.get(name, "")) for name in ("width", "height"))  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        raise DocumentError(f"{where}: has no resolution; export the cameras again") from None
    if calibration.find("f") is not None:  # since version 1.1
        fy = number("f")
        fx = fy + number("b1")
        cx, cy = width / 2 + number("cx"), height / 2 + number("cy")
        skew = number("b2")
    else:
        fx, fy = number("fx", None), number("fy", None)
        cx, cy, skew = number("cx", width / 2), number("cy", height / 2), number("skew")
    if abs(skew) * height > SKEW * 2 * fy or any(number(name) for name in ("k4", "p3", "p4")):
        raise DocumentError(
            f"{where}: b2, k4, p3 and p4 are not known here; export undistorted photos and their "
            "cameras, or align with these fixed at 0"
        )
    k = (number("k1"), number("k2"), number("p2"), number("p1"), number("k3"))
    return checked_lens(Lens(width, height, fx, fy, cx - 0.5, cy - 0.5, k), where)


def _numbers(element: ET.Element, count: int, where: str) -> np.ndarray:
    text = element.text or ""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise DocumentError(f"{where}: <{element.tag}>: expected {count} numbers, found {text!r}")
    return values
