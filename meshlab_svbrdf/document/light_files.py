"""Lights from a JSON file: a result's lights.json, or one that somebody wrote in its form.

{"lights": [{"direction": [x, y, z], "position": [x, y, z] | null, "gain": g, "color": [r, g, b]}],
 "ambient": [r, g, b] | null}

`position` is the world's and wins over `direction`, which is enough for a far light; `gain` and
`color` are 1 where they are left out. Scenes that describe their "emitters" in the same way, with a
"phong_intensity" per channel and an "ambient_radiance" are read too; their positions are in object
radii from the centre, unless "units" begins with "positions in world units".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import DocumentError
from .stored import read_json


class LightEntry(NamedTuple):
    """direction : (3,) unit from the object's centre, or None; position : (3,), or None where it is
    far; in_radii : whether the position counts in object radii from the centre; color : (3,)"""

    direction: np.ndarray | None
    position: np.ndarray | None
    in_radii: bool
    color: np.ndarray


class LightFile(NamedTuple):
    """lamps, and ambient : (3,) radiance from everywhere, 0 for none"""

    lamps: list[LightEntry]
    ambient: np.ndarray


def read_light_file(path: str | Path) -> LightFile:
    """The lights of a file.

    Raises DocumentError where it is missing, no JSON, or a light lacks what is needed.
    """
    content = read_json(Path(path))
    told = content if isinstance(content, dict) else {}
    entries = told.get("lights", told.get("emitters"))
    if not isinstance(entries, list) or not entries:
        raise DocumentError(f'{path}: expected {{"lights": [...]}} with at least one light')
    emitters = "lights" not in told
    in_radii = emitters and not str(told.get("units", "")).startswith("positions in world units")
    ambient = _vector(told, "ambient" if "ambient" in told else "ambient_radiance", str(path))
    lamps = [_light(entry, f"{path}: light {k}", in_radii) for k, entry in enumerate(entries)]
    for k, entry in enumerate(entries if emitters else ()):
        if entry.get("phong_intensity") is None:
            raise DocumentError(f"{path}: light {k}: an emitter needs its phong_intensity")
    return LightFile(lamps, np.zeros(3) if ambient is None else np.maximum(ambient, 0))


def _light(entry: Any, where: str, in_radii: bool) -> LightEntry:
    if not isinstance(entry, dict):
        raise DocumentError(f"{where}: expected an object with direction, position and gain")
    direction, position = (_vector(entry, key, where) for key in ("direction", "position"))
    if position is None and (direction is None or not np.linalg.norm(direction) > 0):
        raise DocumentError(f"{where}: expected a direction, three numbers, or a position")
    if position is None and direction is not None:
        direction = direction / np.linalg.norm(direction)
    gain = entry.get("gain", 1.0)
    if not isinstance(gain, int | float) or not np.isfinite(gain) or gain < 0:
        raise DocumentError(f"{where}: gain is {gain!r}, expected a number of 0 or more")
    color = _vector(entry, "color", where)
    if color is None:
        color = _vector(entry, "phong_intensity", where)
    color = gain * (np.ones(3) if color is None else color)
    if (color < 0).any():
        raise DocumentError(f"{where}: color is negative")
    return LightEntry(direction, position, in_radii, color)


def _vector(entry: dict[str, Any], key: str, where: str) -> np.ndarray | None:
    value = entry.get(key)
    if value is None:
        return None
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise DocumentError(f"{where}: {key} is {value!r}, expected three numbers")
    return vector
