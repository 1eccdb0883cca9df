"""What a run will cost: time, disk and memory, from a few counts.

Projecting is measured on the frames themselves. Later passes are taken from RATES, scaled by how
fast this machine does a fixed piece of work (`yardstick`).
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from ..blocks import LARGE
from ..samples.chunks import HELD_BYTES

SAMPLE_BYTES = 5
OFFSET_BYTES = 4
CHUNK_FRAMES = 256
SAMPLES = "compute_svbrdf_samples"
MATERIALS = "compute_svbrdf_materials"
GLOSS = "compute_svbrdf_material_specular"

MEASURED_YARDSTICK = 0.0065
"""Seconds of `yardstick` on the machine where RATES were measured."""


@dataclass(frozen=True)
class Work:
    """How much there is to do.

    frames : to be used; samples : of all texels in all of them; texels, vertices : of the object
    environment, fitted : samples that the environment map and the joint fit are made from, at most
    directions : rays per vertex; 0: no visibility
    cores : threads that run at a time
    decode, project : CPU seconds a frame; measured
    """

    frames: int
    samples: float
    texels: float
    vertices: int
    environment: float
    fitted: float
    directions: int
    cores: int
    decode: float
    project: float

    def amounts(self) -> dict[str, float]:
        """What RATES multiply."""
        return {
            "once": 1.0,
            "frames": self.frames,
            "samples": self.samples / 1e6,
            "environment": min(self.samples, self.environment) / 1e6,
            "fitted": min(self.samples, self.fitted) / 1e6,
            "texels": self.texels / 1e6,
            "rays": self.vertices * self.directions / 1e6,
        }


@dataclass(frozen=True)
class Rate:
    """CPU seconds of one filter, by amount (samples, texels and rays in millions).

    shared : the part of it that runs on all cores
    """

    shared: float
    seconds: Mapping[str, float]


BY_COLOR = Rate(0.0, {"texels": 4.0})
"""Of MATERIALS where no highlights are compared."""
UNFITTED = Rate(0.5, {"once": 0.5, "texels": 2.0, "samples": 0.05})
"""Of GLOSS where nothing is fitted."""
PROGRAM_BYTES, MATERIAL_BYTES, TEXEL_BYTES, FITTED_BYTES = 250e6, 420.0, 330.0, 60.0
"""Of memory that is no file's: of the program; per texel, while materials grow and else; per
fitted sample."""
GROWN_TEXELS = 1e6
"""Materials grow on no more than these (`reflectance.materials.segment_surface`)."""
HELD_TEXELS = LARGE / 12
"""Of more texels what is worked on lies in files (`blocks.room`), three float32 each."""
FILED_BYTES = 89.0
"""Of memory, per texel of all, however many there are (docs/huge_objects.md)."""
MESH_BYTES = 380.0
"""Of memory, per vertex, while rays are shot and frames are sampled: the most of all stages of
`meshlab-svbrdf bench --tiles` on 10⁷ triangles, less the program's (docs/huge_objects.md)."""
RESULT_BYTES, VERTEX_BYTES, MAP_BYTES = 300.0, 300.0, 5e6
"""On disk: per texel, per vertex, and of the environment map."""

RATES: dict[str, Rate] = {
    "compute_svbrdf_texels": Rate(0.0, {"once": 0.09, "texels": 0.75}),
    "compute_svbrdf_visibility": Rate(0.95, {"rays": 0.207}),
    SAMPLES: Rate(0.9, {"frames": 0.006, "samples": 0.027}),  # besides what is measured
    "compute_svbrdf_luminance_threshold": Rate(0.95, {"samples": 0.018}),
    "generate_svbrdf_environment_map": Rate(0.5, {"environment": 0.173, "samples": 0.0075}),
    "compute_svbrdf_diffuse_color": Rate(0.9, {"once": 0.62, "samples": 0.143}),
    "compute_svbrdf_light_sources": Rate(0.0, {"once": 0.08}),
    "compute_svbrdf_texel_specular": Rate(0.9, {"once": 0.25, "samples": 0.083}),
    MATERIALS: Rate(0.3, {"once": 1.0, "texels": 13.0}),
    GLOSS: Rate(0.7, {"once": 9.2, "texels": 16.1, "fitted": 0.84, "samples": 0.5}),
}
"""Least squares over runs of two films: `python benchmarks/fit_rates.py` (docs/plan.md)."""


def stage_seconds(
    work: Work,
    speed: float = 1.0,
    estimator: str = "joint",
    gloss: str = "seek",
    filters: Collection[str] | None = None,
) -> dict[str, float]:
    """Seconds that each of the filters (None: all) will take, when nothing else runs.

    speed : of this machine, against that where RATES were measured; the measured part of `work` is
        in this machine's own seconds
    estimator, gloss : parameters of compute_svbrdf_material_specular, which may spare its fit
    """
    amounts, found = work.amounts(), {}
    for name, rate in RATES.items():
        if filters is not None and name not in filters:
            continue
        if estimator == "paper" or gloss == "none":
            rate = {GLOSS: UNFITTED, MATERIALS: BY_COLOR}.get(name, rate)
        cpu = sum(per * amounts[what] for what, per in rate.seconds.items()) / speed
        if name == SAMPLES:
            cpu += work.frames * (work.decode + work.project)
        found[name] = cpu * (1 - rate.shared + rate.shared / work.cores)
    return found


def this_machine() -> float:
    """How fast it is, against the one where RATES were measured."""
    return MEASURED_YARDSTICK / yardstick()


def result_bytes(work: Work) -> float:
    """What all results but the store take on disk."""
    return RESULT_BYTES * work.texels + VERTEX_BYTES * work.vertices + MAP_BYTES


def memory_bytes(work: Work, held: int) -> float:
    """Memory at its peak that is no file's: of projecting, of growing materials, of the fit, or of
    the mesh.

    held : bytes of samples that are held before a chunk is written
    """
    frame = HELD_BYTES * min(work.samples / max(work.frames, 1), work.texels)
    projecting = min(float(held), HELD_BYTES * work.samples) * (2 + SAMPLE_BYTES / HELD_BYTES)
    projecting += min(3 * work.cores * frame, 3.0 * held)  # sampled ahead, and while they are
    fitting = FITTED_BYTES * min(work.samples, work.fitted)
    at_texels = TEXEL_BYTES * min(work.texels, HELD_TEXELS) + max(projecting, fitting)
    growing = MATERIAL_BYTES * min(work.texels, GROWN_TEXELS)
    most = max(at_texels, growing, MESH_BYTES * work.vertices)
    return PROGRAM_BYTES + FILED_BYTES * work.texels + most


def store_bytes(samples: float, texels: float, frames: int, memory: int, bits: int = 8) -> float:
    """The sample store's size on disk.

    memory : bytes of samples that are held before a chunk is written
    bits : of each sample's four values, 8 or 16
    """
    more = (bits - 8) / 2
    held = samples * (HELD_BYTES + more)
    chunks = max(np.ceil(frames / CHUNK_FRAMES), np.ceil(held / max(memory, 1)))
    return (SAMPLE_BYTES + more) * samples + OFFSET_BYTES * (texels + 1) * float(chunks)


def yardstick(repeats: int = 5) -> float:
    """CPU seconds that a fixed piece of work takes here: decoding, sorting, exponentials."""
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (480, 640, 3), dtype=np.uint8), (9, 9), 0)
    _, jpeg = cv2.imencode(".jpg", picture)
    numbers = rng.random(200_000)
    taken = []
    for _ in range(repeats):
        start = time.thread_time()
        cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
        np.exp(np.sort(numbers)).sum()
        taken.append(time.thread_time() - start)
    return float(np.median(taken))
