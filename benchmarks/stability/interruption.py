"""Runs that are killed, full disks, too little memory: what was there stays, the next run goes on.

A tiny film's whole chain runs in a process that is killed without warning at a random moment. Then
every file that the record names must be whole, everything made before must be unchanged, and the
same command must go on to the result of a run that nobody disturbed, bit by bit.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.document.record import RECORD, ResultFolder
from meshlab_svbrdf.document.stored import read_array, read_json
from meshlab_svbrdf.errors import SvbrdfError
from sample_projects.make_totem import TINY, make_totem

from ..ledger import ROOT

FILM = replace(TINY, frames=24, orbits=1, width=75, height=100, texture=64, columns=32)
CHAIN = (
    "compute_svbrdf_texels", "compute_svbrdf_visibility", "compute_svbrdf_samples",
    "compute_svbrdf_luminance_threshold", "generate_svbrdf_environment_map",
    "compute_svbrdf_diffuse_color", "compute_svbrdf_light_sources", "compute_svbrdf_texel_specular",
    "compute_svbrdf_materials", "compute_svbrdf_material_specular", "compute_svbrdf_albedo",
)  # fmt: skip
GIVEN: dict[str, dict[str, Any]] = {"compute_svbrdf_texels": {"texture_size": 64}}
NAME, SAVING = "totem", "saving"
STAGES = (*CHAIN, SAVING)
FINISH = 0.1  # of the kills, after which the run is let go on to its end
PROGRESS = "plan: ", "compiling kernels"
HIDDEN = (".lock", ".staging", ".commit", ".partial")


def kill_runs(folder: Path, kills: int, seed: int = 0) -> dict[str, Any]:
    """Kill the chain `kills` times; a row with how often in each stage, and what broke."""
    project = make_totem(folder / "film", FILM).path
    film = digests(folder / "film")
    rng = np.random.default_rng(seed)
    _run(project, folder / "warm")  # compiles, so that forked runs need not
    cv2.setNumThreads(0)  # the pool does not survive a fork
    expected = _result(_to_the_end(project, folder / "undisturbed"))
    lasted = _durations(project, folder / "timed")
    counts: Counter[str] = Counter()
    broke: list[str] = []
    finished = 0
    output = folder / "out"
    while counts.total() < kills:
        before = _state(output)
        target = STAGES[rng.integers(len(STAGES))]
        stage = _killed(target, float(rng.uniform(0, 1.2 * lasted[target])), project, output)
        if stage:
            counts[stage] += 1
            broke += _problems(output, before)
        if not stage or counts.total() == kills or rng.random() < FINISH:
            broke += _differences(expected, _result(_to_the_end(project, output)))
            shutil.rmtree(output)
            finished += 1
    if digests(folder / "film") != film:
        broke.append("the film changed")
    return {"kills": counts.total(), "stages": {s: counts[s] for s in STAGES},
            "finished": finished, "broke": broke}  # fmt: skip


def fill_disks(folder: Path, sizes: int, seed: int = 0) -> dict[str, Any]:
    """Run the chain with files that may not grow beyond a size, as on a disk that is full.

    Half of the sizes are any; the others are a little less than one of the result's files needs.
    """
    project = make_totem(folder / "film", FILM).path
    _run(project, folder / "warm")
    cv2.setNumThreads(0)
    expected = _result(_to_the_end(project, folder / "undisturbed"))
    whole = [path.stat().st_size for path in (folder / "undisturbed").rglob("*") if path.is_file()]
    rng = np.random.default_rng(seed)
    told: Counter[str] = Counter()
    broke: list[str] = []
    output = folder / "out"
    wide = np.exp(rng.uniform(np.log(64), np.log(max(whole)), sizes // 2))
    tight = rng.choice(whole, sizes - len(wide)) - np.exp(rng.uniform(0, np.log(9_000), sizes // 2))
    for size in np.maximum([*wide, *tight], 0).astype(int):
        before = _state(output)
        said = _limited(int(size), project, output)
        if said.startswith("Error: "):
            told["told"] += 1
        elif said:
            broke.append(f"{size} bytes a file: {said}")
        else:
            told["enough room"] += 1
        broke += _problems(output, before)
        broke += _differences(expected, _result(_to_the_end(project, output)))
        shutil.rmtree(output)
    return {"tried": sizes, "told": told["told"], "enough": told["enough room"], "broke": broke}


def limit_memory(folder: Path, megabytes: Sequence[int]) -> dict[str, Any]:
    """Run the shell's command with that much address space; what it says, and what broke.

    Of 1024² texels: the libraries take 1.5 GB, the least limits stop the run halfway.
    """
    project = make_totem(folder / "film", FILM).path
    output = folder / "out"
    expected = _result(_in_shell(project, folder / "undisturbed")[1])
    rows = []
    for size in megabytes:
        before = _state(output)
        said, _ = _in_shell(project, output, size << 20)
        broke = _problems(output, before)
        if said and (not said.startswith("Error: ") or "Traceback" in said):
            broke.append(said)
        broke += _differences(expected, _result(_in_shell(project, output)[1]))
        shutil.rmtree(output)
        rows.append({"megabytes": size, "said": said, "broke": broke})
    return {"memory": rows}


def _in_shell(project: Path, output: Path, limit: int = resource.RLIM_INFINITY) -> tuple[str, Path]:
    """What a run in a process of its own says of errors, "" for none; and the result's project."""
    command = [sys.executable, "-m", "meshlab_svbrdf.cli", "run", str(project), "-o", str(output)]
    done = subprocess.run(
        [*command, "--texture-size", "1024"], cwd=ROOT, capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )  # fmt: skip
    said = "\n".join(line for line in done.stderr.splitlines() if not line.startswith(PROGRESS))
    if done.returncode not in (0, 1):
        said = f"ended with {done.returncode}: {said}"
    return said if done.returncode else "", output / project.name


def _run(project: Path, output: Path, say: Callable[[str], None] = lambda stage: None) -> Path:
    document = Document.open(project, output)
    for name in CHAIN:
        say(name)
        document.apply(name, **GIVEN.get(name, {}))
    say(SAVING)
    return document.save()


def _forked(work: Callable[[], None]) -> int:
    """Start `work` in a process of its own; its id."""
    process = os.fork()
    if process == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return process


def _to_the_end(project: Path, output: Path) -> Path:
    """Run undisturbed, in a process of its own, so that nothing is remembered from other runs."""
    _, status = os.waitpid(_forked(lambda: _run(project, output)), 0)
    if status:
        raise RuntimeError(f"a run that nobody disturbed ended with {status}")
    return output / project.name


def _durations(project: Path, output: Path) -> dict[str, float]:
    """Seconds that each stage takes."""
    begun: dict[str, float] = {}
    _run(project, output, lambda stage: begun.update({stage: time.perf_counter()}))
    times = [*begun.values(), time.perf_counter()]
    return {stage: times[k + 1] - times[k] for k, stage in enumerate(begun)}


def _killed(target: str, seconds: float, project: Path, output: Path) -> str:
    """Kill a run so long after a stage began; the stage it was in then, "" where it had ended."""
    read, write = os.pipe()

    def work() -> None:
        os.close(read)
        _run(project, output, lambda stage: os.write(write, f"{stage}\n".encode()))

    process = _forked(work)
    os.close(write)
    with os.fdopen(read) as stream:
        stages = [next(stream, "").strip()]
        while stages[-1] not in (target, ""):
            stages.append(next(stream, "").strip())
        time.sleep(seconds)
        os.kill(process, signal.SIGKILL)
        _, status = os.waitpid(process, 0)
        stages += stream.read().split()
    if os.WIFEXITED(status):
        if os.WEXITSTATUS(status):
            raise RuntimeError(f"a run failed by itself, in {stages[-1]}")
        return ""
    return stages[-1]


def _limited(size: int, project: Path, output: Path) -> str:
    """What a run says whose files may have `size` bytes; "" where that was enough."""
    read, write = os.pipe()

    def work() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        try:
            _run(project, output)
        except (SvbrdfError, OSError) as error:
            os.write(write, f"Error: {error}".encode())
        except BaseException as error:
            os.write(write, repr(error).encode())

    process = _forked(work)
    os.close(write)
    with os.fdopen(read) as stream:
        said = stream.read()
    os.waitpid(process, 0)
    return said


def digests(folder: Path) -> dict[str, str]:
    """Of every file that is not a run's own."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part in HIDDEN for part in path.parts)
    }


def _state(output: Path) -> tuple[dict[str, str], dict[str, Any]]:
    """Digests of all files, and the products, of what is there for the next run."""
    folder = output / f"{NAME}.svbrdf"
    return digests(output) if output.is_dir() else {}, ResultFolder(folder).record["products"]


def _problems(output: Path, before: tuple[dict[str, str], dict[str, Any]]) -> list[str]:
    """What the next run finds that is not whole, or not what it was."""
    files, products = before
    try:
        now_files, now = _state(output)
    except SvbrdfError as error:
        return [f"cannot be opened: {error}"]
    folder = output / f"{NAME}.svbrdf"
    found = []
    for name, product in now.items():
        for entry in product["files"]:
            found += [f"{name}: {p}" for p in _unreadable(folder / entry)]
    made = {f for n, p in now.items() if products.get(n, {}).get("key") != p["key"]
            for f in p["files"]}  # fmt: skip
    for name, product in products.items():
        if name not in now:
            found.append(f"{name}: is gone")
            continue
        for entry in set(product["files"]) - made:
            key = f"{folder.name}/{entry}"
            same = files.get(key) == now_files.get(key)
            found += [] if same else [f"{name}: {entry} changed"]
    if (output / f"{NAME}.mlp").exists():
        try:
            read_project(output / f"{NAME}.mlp")
            found += [f"{layer}" for path in folder.glob("layers/*.ply")
                      for layer in _unreadable(path)]  # fmt: skip
        except SvbrdfError as error:
            found.append(str(error))
    return found


def _unreadable(path: Path) -> list[str]:
    """Why a result's file cannot be read, if that is so."""
    readers = {".npy": read_array, ".json": read_json, ".exr": read_exr, ".png": read_image,
               ".ply": read_mesh}  # fmt: skip
    if path.is_dir():
        return [problem for each in sorted(path.iterdir()) for problem in _unreadable(each)]
    if not path.exists():
        return [f"{path.name} is missing"]
    try:
        readers.get(path.suffix, Path.read_bytes)(path)
    except SvbrdfError as error:
        return [str(error)]
    return []


def _result(project: Path) -> dict[str, Any]:
    """Digests of a result; of the record, what does not tell of time."""
    folder = project.with_suffix(".svbrdf")
    found: dict[str, Any] = digests(project.parent)
    record = json.loads((folder / RECORD).read_text())
    for run in record["runs"].values():
        for name in ("seconds", "cpu_seconds", "date"):
            run.pop(name)
    return found | {f"{folder.name}/{RECORD}": record}


def _differences(expected: dict[str, Any], found: dict[str, Any]) -> list[str]:
    return [
        f"{name} differs from an undisturbed run's"
        for name in sorted(expected.keys() | found.keys())
        if expected.get(name) != found.get(name)
    ]
