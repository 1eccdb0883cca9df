"""Programs that judge and show glTF, where they are installed.

`python -m benchmarks.exports.node FOLDER` installs the packages of JavaScript and prints where;
MESHLAB_SVBRDF_NODE names that place. Without it the tests are skipped and say so.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.exports import node, three
from meshlab_svbrdf.geometry.camera import Camera

VARIABLE = "MESHLAB_SVBRDF_NODE"


def _modules() -> Path:
    if reason := node.why_not():
        pytest.skip(reason)
    if not os.environ.get(VARIABLE):
        pytest.skip(f"{VARIABLE} names no folder of packages (python -m benchmarks.exports.node)")
    return Path(os.environ[VARIABLE])


def judge_gltf(path: Path) -> list[str]:
    """What Khronos' validator says of errors, warnings, infos and hints, but for odd sizes."""
    issues = node.validated(path, _modules())["issues"]["messages"]
    return [issue["message"] for issue in issues if issue["code"] != "IMAGE_NPOT_DIMENSIONS"]


def show_in_three(glb: Path, camera: Camera) -> np.ndarray:
    """A view in three.js, (H, W, 3) linear, on the renderers' grey."""
    if importlib.util.find_spec("playwright") is None or three.chromium() is None:
        pytest.skip("needs Playwright's Python package, and Chromium on the PATH")
    return three.render(glb, [camera], _modules(), 118)[0]
