"""Mitsuba's own inverse rendering: albedo, specular and environment by gradient descent.

From grey and a uniform sky, Adam changes an albedo per texel, ρs and α per material (the true
segmentation is given) and an environment map, so that renderings come near the frames. An error
counts by the slope of sRGB at the frame's pixel; a clipped pixel counts where its rendering is
darker. The frames' exposures, as our result has them, are taken off. Path replay, direct light.

Its light comes from far away: a map of directions has no place for near lamps.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from meshlab_svbrdf.document.images import read_image, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.raster import rasterise
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ..scenes.score import Scores, diffuse, unseen_views
from .capture import Capture, write_maps

try:
    import drjit as dr
    import mitsuba as mi

    from . import mitsuba_scene as unknown
except ImportError as error:
    raise SvbrdfError(
        f"Mitsuba cannot be imported ({error}): pip install 'meshlab-svbrdf[benchmark]'"
    ) from error

SKY = (64, 128)
SAMPLES = 4  # per pixel of a frame
RATES = {"albedo": 0.06, "sky": 0.2, "rho_s": 0.06, "alpha": 0.06}  # sky, ρs, α as logarithms
COOLING = 0.05  # what the rates have come down to at the end
CHECKPOINTS = (0.2, 0.5, 1.0)  # of the minutes
JUDGED = 256  # samples of each pixel and texel that is judged


class Unknowns:
    """What the descent changes, and the scene that shows it."""

    def __init__(self, capture: Capture, ids: np.ndarray):
        size = capture.size
        self.capture, self.size = capture, size
        self.scene = unknown.load_scene(capture.mesh, size, SKY)
        self.parameters = mi.traverse(self.scene)
        self.ids = mi.UInt32(unknown.material_texels(ids, size).ravel())
        count = int(ids.max()) + 1
        start = {
            "albedo": mi.TensorXf(np.full((size, size, 3), 0.5, np.float32)),
            "sky": mi.TensorXf(np.zeros((*SKY, 3), np.float32)),
            "rho_s": mi.Float(np.full(count, np.log(0.2))),
            "alpha": mi.Float(np.full(count, np.log(20.0))),
        }
        self.adam = mi.ad.Adam(lr=0.0, params=start, mask_updates=True)
        self.cool(0.0)
        self.show()

    def show(self) -> None:
        """Put the unknowns into the scene, within their bounds."""
        adam = self.adam
        adam["albedo"] = dr.clip(adam["albedo"], 0.0, 1.0)
        adam["alpha"] = dr.clip(adam["alpha"], 0.0, float(np.log(2000)))
        self.parameters[unknown.ALBEDO] = adam["albedo"]
        self.parameters[unknown.LIGHT] = unknown.padded(dr.exp(adam["sky"]))
        for name, key in (("rho_s", unknown.RHO_S), ("alpha", unknown.ALPHA)):
            self.parameters[key] = unknown.per_texel(dr.exp(adam[name]), self.ids, self.size)
        self.parameters.update()

    def step(self, sensor: mi.Sensor, frame: np.ndarray, on: np.ndarray, seed: int) -> None:
        """One step towards a frame.

        frame : (H, W, 3) linear, its exposure taken off; on : (H, W, 3) its weight, 0 off the
        object, negative where clipped
        """
        image = mi.render(
            self.scene, self.parameters, sensor=sensor, spp=SAMPLES, seed=2 * seed,
            seed_grad=2 * seed + 1,
        )  # fmt: skip
        error = image[..., :3] - mi.TensorXf(frame)
        weight = mi.TensorXf(on)
        weight = dr.select((weight < 0) & (error > 0), 0, dr.abs(weight))
        dr.backward(dr.mean(weight * error * error))
        self.adam.step()
        self.show()

    def cool(self, progress: float) -> None:
        """Lower the rates; progress : 0..1."""
        self.adam.set_learning_rate({k: v * COOLING**progress for k, v in RATES.items()})

    def write(self, truth: Path, folder: Path) -> None:
        """Write maps/ and views/."""
        texels = self.capture.texels
        albedo = np.array(self.adam["albedo"])[texels.row, texels.col]
        light = unknown.irradiance(self.scene, texels, self.capture.mesh, JUDGED)
        write_maps(folder, texels.to_images((albedo * light).astype(np.float32))[0])
        views = folder / "views"
        views.mkdir(exist_ok=True)
        for raster in read_project(truth / "views" / "project.mlp").rasters:
            camera = raster.camera.about(self.capture.center)
            sensor = unknown.sensor(camera)
            image = np.array(mi.render(self.scene, sensor=sensor, spp=JUDGED, seed=1))
            write_png(views / raster.path.name, to_srgb8(image[..., :3]))


def run(capture: Capture, truth: Path, folder: Path, minutes: float) -> Scores:
    """Also tells `over_time`: seconds, ΔE mean and dB at each checkpoint, scoring not counted."""
    frames = _Frames(capture)
    spent = -time.perf_counter()
    unknowns = Unknowns(capture, read_image(truth / "material_id.png"))
    random, steps, over_time = np.random.default_rng(1), 0, []
    order: list[int] = []
    for checkpoint in CHECKPOINTS:
        while (progress := (spent + time.perf_counter()) / (60 * minutes)) < checkpoint:
            order = order or random.permutation(len(frames)).tolist()
            unknowns.cool(progress)
            unknowns.step(*frames[order.pop()], seed=steps)
            steps += 1
        spent += time.perf_counter()
        unknowns.write(truth, folder)
        figures = diffuse(folder, truth) | unseen_views(folder / "views", truth)
        over_time.append({"seconds": spent, "steps": steps} | figures)
        spent -= time.perf_counter()
    return {"seconds": over_time[-1]["seconds"], "over_time": over_time}


class _Frames:
    """Frames as the descent wants them: sensor, linear pixels, weights; of windows of one size."""

    def __init__(self, capture: Capture):
        self.capture = capture
        self.gains = capture.document.array("samples_gain")
        self.vertices = np.ascontiguousarray(capture.mesh.vertices)
        boxes = np.array([self._box(raster.camera) for raster in capture.rasters])
        self.size = (boxes[:, 1] - boxes[:, 0]).max(0)

    def _box(self, camera: Camera) -> np.ndarray:
        """First and last column and row of the object, [[left, top], [right, bottom]]."""
        points = camera.project(self.vertices)[:, :2]
        limits = [camera.width, camera.height]
        low, high = np.floor(points.min(0)), np.ceil(points.max(0)) + 1
        return np.clip([low, high], 0, limits).astype(int)

    def __len__(self) -> int:
        return len(self.capture.rasters)

    def __getitem__(self, k: int) -> tuple[mi.Sensor, np.ndarray, np.ndarray]:
        # Cut the window out
        raster = self.capture.rasters[k]
        camera = raster.camera
        width, height = np.minimum(self.size, [camera.width, camera.height])
        left, top = np.minimum(self._box(camera)[0], [camera.width - width, camera.height - height])
        code = self.capture.frame(raster)[top : top + height, left : left + width]
        camera = replace(
            camera, width=int(width), height=int(height), cx=camera.cx - left, cy=camera.cy - top
        )

        # Weigh the pixels that the object fills
        linear = decode(code / 255)
        _, face = rasterise(self.vertices, self.capture.mesh.faces, camera)
        inside = cv2.erode((face >= 0).astype(np.uint8), np.ones((3, 3), np.uint8))
        weight = inside[..., None] / (linear + 0.02)
        weight[code >= 254] *= -1
        frame = (linear / self.gains[k]).astype(np.float32)
        return unknown.sensor(camera), frame, weight.astype(np.float32)
