"""One measurement in a process of its own: `python -m meshlab_svbrdf.bench.child REQUEST ANSWER`.

A process of its own starts with fresh memory, so that its peak is the run's, and keeps to the cores
that it was given. Both files are JSON; the request names one of TASKS and its arguments.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.event import install_recorder

from ..document.document import Document
from ..document.frames import Frames, FramesInOrder
from ..document.mesh_files import write_ply
from ..presets import chain
from ..registration.track import register_frames
from ..script import run_script
from ..threads import thread_count
from . import watch
from .analysis import TEXELS, VISIBILITY
from .body import body
from .files import ahead
from .first_run import TINY, TINY_FRAMES, TINY_SIZE, list_kernels
from .workload import make_workload

Figures = dict[str, Any]
SAVE = "save"  # the last stage: the project with its layers


def run_chain(
    project: str, output: str, estimator: str, preset: str, settings: dict[str, str],
    warm: bool = True,
) -> Figures:  # fmt: skip
    """Run the chain with warm kernels; decode the frames before it and after it.

    warm : False: each kernel is loaded by the stage that uses it, within its time
    compiled : kernels that were compiled all the same
    """
    warmed = warm_up(estimator)["seconds"] if warm else 0.0
    document = Document.open(project, output)
    decode = [decode_frames(document)]
    peak_before = peak_memory()
    stages = []
    with install_recorder("numba:compile") as recorder:
        for name, meter in _stages(document, estimator, preset, settings):
            stages.append({"name": name} | meter)
            memory = f"{meter['peak'] >> 20} MiB, {meter['own'] >> 20} of them no file's"
            spent = f"{meter['seconds']:7.1f} s, {meter['cpu_seconds']:.1f} CPU s"
            line = f"{name:36} {spent}, {memory}  {meter['said']}"
            print(line, file=sys.stderr, flush=True)
    decode.append(decode_frames(document))
    return {
        "preset": preset,
        "estimator": estimator,
        "threads": thread_count(),
        "warm_seconds": warmed,
        "compiled": sum(event.is_start for _, event in recorder.buffer),
        "peak_before": peak_before,
        "peak": max(stage["peak"] for stage in stages),
        "decode": _mean(decode),
        "decodes": decode,
        "stages": stages,
    } | sizes_of(document)


def _stages(
    document: Document, estimator: str, preset: str, settings: dict[str, str]
) -> Iterator[tuple[str, Figures]]:
    outcomes = run_script(document, chain(estimator, preset, settings))
    while True:
        with metered() as figures:
            outcome = next(outcomes, None)
        if outcome is None:
            break
        yield outcome.name, figures | {"said": outcome.message}
    with metered() as figures:
        document.save()
    yield SAVE, figures | {"said": "the project with its layers"}


def sizes_of(document: Document) -> Figures:
    """How much there was to do, and what of it lies on the disk."""
    mesh, told = document.mesh(), document.json("frames")
    used = [frame["samples"] for frame in told["frames"] if "samples" in frame]
    store = [path.stat().st_size for path in (document.folder / "samples").rglob("*")]
    materials = document.json("materials")["materials"] if document.has_json("materials") else []
    return {
        "frames": len(document.rasters),
        "frames_used": len(used),
        "reduce": told.get("reduce", 1),
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "texels": len(document.texels()),
        "samples": sum(used),
        "store_bytes": sum(store),
        "disk": disk_of(document),
        "clusters": len(materials),
    }


def disk_of(document: Document) -> int:
    """Bytes of all results."""
    files = (path for path in document.folder.rglob("*") if path.is_file())
    return sum(path.stat().st_size for path in files)


def run_surface(folder: str, triangles: int, size: int, directions: int) -> Figures:
    """The stages that need the mesh alone, on one of about so many triangles."""
    place = Path(tempfile.mkdtemp(dir=folder))
    mesh = body(triangles)
    write_ply(place / "body.ply", mesh)
    given: dict[str, dict[str, Any]] = {
        TEXELS: {"texture_size": size},
        VISIBILITY: {"mode": "always", "directions": directions},
    }
    stages = []
    del mesh
    document = Document.of_mesh(place / "body.ply", place / "out.mlp")
    for name, parameters in given.items():
        with metered() as meter:
            document.apply(name, **parameters)
        stages.append({"name": name} | meter)
    told = {"stages": stages, "triangles": len(document.mesh().faces), "disk": disk_of(document)}
    shutil.rmtree(place)
    return told


def decode_frames(document: Document) -> Figures:
    """Only decode every frame of the project, on all cores: the floor of any run."""
    rasters = document.rasters

    with metered() as figures, Frames(rasters) as frames:
        for _ in ahead(lambda index: frames.read(rasters[index]).shape, range(len(rasters))):
            pass
    return figures | {"frames": len(rasters)}


def warm_up(estimator: str = "joint") -> Figures:
    """Load every kernel from its cache, or compile it, by a run on next to nothing."""
    folder = Path(tempfile.mkdtemp(prefix="svbrdf-warm-"))
    try:
        with metered() as figures:
            project = make_workload(folder, TINY_FRAMES, TINY).project
            document = Document.open(project, folder / "out")
            small = {"compute_svbrdf_texels.texture_size": str(TINY_SIZE)}
            for _ in run_script(document, chain(estimator, "full", small)):
                pass
            document.save()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return figures


@contextmanager
def metered() -> Iterator[Figures]:
    """Wall clock and CPU seconds of what is inside, and the process's peak memory in bytes.

    peak : of all pages; own : of those that are no file's, which alone the system cannot take back
        (as `watch.py` sees it; all pages, where the system does not tell)
    """
    figures: Figures = {}
    command = [sys.executable, "-I", "-S", watch.__file__, str(os.getpid())]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as watching:
        assert watching.stdout is not None
        watching.stdout.readline()  # it has begun
        _forget_peak()
        wall, cpu = time.perf_counter(), time.process_time()
        yield figures
        figures["seconds"] = time.perf_counter() - wall
        figures["cpu_seconds"] = time.process_time() - cpu
        figures["peak"] = peak_memory()
        own = int(watching.communicate()[0])
    figures["own"] = max(own, watch.status("RssAnon")) or figures["peak"]


def peak_memory() -> int:
    """Bytes resident at most: since `_forget_peak` where the system tells (Linux), else ever."""
    unit = 1 if sys.platform == "darwin" else 1 << 10
    return watch.status("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _forget_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _mean(figures: list[Figures]) -> Figures:
    return {key: sum(each[key] for each in figures) / len(figures) for key in figures[0]}


def run_decode(project: str) -> Figures:
    """Only decode every frame of a project."""
    return decode_frames(Document.open(project)) | {"threads": thread_count()}


def run_registration(project: str, count: int) -> Figures:
    """Register the first frames of a project from the first one's camera, decoding them included.

    error : pixels, RMS over the mesh's vertices, of the median frame, against the project's cameras
    """
    document = Document.open(project)
    mesh, rasters = document.mesh(), document.rasters[:count]
    with Frames(rasters) as pixels:
        frames, two = (FramesInOrder(pixels, some) for some in (rasters, rasters[:2]))
        start = {0: rasters[0].camera}
        register_frames(mesh.vertices, mesh.faces, two, start)  # warm
        with metered() as figures:
            found = register_frames(mesh.vertices, mesh.faces, frames, start).cameras
    errors = [
        np.sqrt(((c.project(mesh.vertices) - raster.camera.project(mesh.vertices)) ** 2)[:, :2]
                .sum(1).mean())
        for k, raster in enumerate(rasters) if (c := found.get(k)) is not None
    ]  # fmt: skip
    error = float(np.median(errors))
    return figures | {"frames": len(rasters), "registered": len(found), "error": error}


TASKS: dict[str, Callable[..., Figures]] = {
    "chain": run_chain, "decode": run_decode, "warm": warm_up, "register": run_registration,
    "surface": run_surface, "list": list_kernels,
}  # fmt: skip


def main() -> None:
    request, answer = (Path(argument) for argument in sys.argv[1:])
    asked = json.loads(request.read_text())
    answer.write_text(json.dumps(TASKS[asked["task"]](**asked["arguments"])))


if __name__ == "__main__":
    main()
