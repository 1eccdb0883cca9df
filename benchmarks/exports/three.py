"""three.js: a page in a headless Chromium that opens a GLB, with the lamps that it holds.

Its lamps cast no shadows unless a page sets up shadow maps: none are wanted here.
"""

from __future__ import annotations

import base64
import shutil
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np

from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.samples.luminance import decode

PAGE = Path(__file__).with_name("three.html")
ORIGIN = "http://three.invalid"
ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
)  # fmt: skip
KINDS = {".js": "text/javascript", ".html": "text/html", ".glb": "model/gltf-binary"}


def chromium() -> str | None:
    return shutil.which("chromium") or shutil.which("chromium-browser")


def render(
    glb: Path, cameras: Sequence[Camera], modules: Path, grey: int, supersampling: int = 3
) -> list[np.ndarray]:
    """Views (H, W, 3), linear, the mean of supersampling² pixels, on `grey`, an sRGB code."""
    from playwright.sync_api import sync_playwright

    def answer(route) -> None:
        path = urlsplit(route.request.url).path
        places = {"/": PAGE, "/model.glb": glb}
        file = places.get(path) or modules / path.lstrip("/")
        if not file.is_file():
            route.fulfill(status=404)
            return
        route.fulfill(body=file.read_bytes(), content_type=KINDS.get(file.suffix, "text/plain"))

    found = []
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=chromium(), args=list(ARGUMENTS))
        page = browser.new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
        page.route("**/*", answer)
        page.goto(f"{ORIGIN}/")
        page.wait_for_function("window.ready")
        page.evaluate("load('/model.glb')")
        for camera in cameras:
            s = supersampling
            url = page.evaluate(
                "a => show(...a)",
                [camera.width * s, camera.height * s, *_matrices(camera), 0x10101 * grey],
            )
            found.append(_mean(_decoded(url), s))
        browser.close()
    if problems:
        raise RuntimeError(f"three.js: {problems[0]}")
    return found


def _matrices(camera: Camera) -> tuple[list[float], list[float]]:
    """The camera's pose and projection as OpenGL has them, column by column."""
    world = np.eye(4)
    world[:3, :3] = (camera.R * np.array([[1], [-1], [-1]])).T
    world[:3, 3] = camera.center
    distance = float(np.linalg.norm(camera.center)) + 1
    near, far = 1e-3 * distance, 10 * distance
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2 * camera.fx / camera.width, 2 * camera.fy / camera.height
    projection[0, 2] = 1 - 2 * (camera.cx + 0.5) / camera.width
    projection[1, 2] = 2 * (camera.cy + 0.5) / camera.height - 1
    projection[2, 2], projection[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
    projection[3, 2] = -1
    return world.T.ravel().tolist(), projection.T.ravel().tolist()


def _decoded(url: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


def _mean(codes: np.ndarray, times: int) -> np.ndarray:
    """The means of times × times pixels, in linear light."""
    height, width = codes.shape[0] // times, codes.shape[1] // times
    return decode(codes / 255).reshape(height, times, width, times, 3).mean((1, 3))
