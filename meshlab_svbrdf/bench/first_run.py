"""The kernels of a run: which there are, and how long a user's first run waits for them.

first_run       a run on next to nothing with no kernel compiled yet, and the same run after it
list_kernels    the list that a first run works through on a second core (../kernel_list.py)

`python -m meshlab_svbrdf.bench.first_run` writes that list anew.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

from numba.core.dispatcher import Dispatcher

from ..kernel_list import to_json
from .workload import Options, make_workload

RUN = (sys.executable, "-m", "meshlab_svbrdf.cli", "run")
TINY = Options(triangles=1200, width=320, height=180, step=7.5, truth=16)
TINY_FRAMES = 48
TINY_SIZE = 128


def first_run(estimator: str) -> dict[str, dict[str, float]]:
    """Seconds, and CPU seconds of both processes, of the first run, the second, and the difference:
    what compiling takes."""
    with tempfile.TemporaryDirectory(prefix="svbrdf-first-") as place:
        project = make_workload(Path(place), TINY_FRAMES, TINY).project
        own = os.environ | {"NUMBA_CACHE_DIR": str(Path(place) / "kernels")}
        told = {
            name: _timed([*RUN, *_options(project, Path(place) / name, estimator)], own)
            for name in ("first", "second")
        }
    first, second = told["first"], told["second"]
    return told | {"compiling": {kind: first[kind] - second[kind] for kind in first}}


def _timed(command: list[str], environment: dict[str, str]) -> dict[str, float]:
    wall, before = time.perf_counter(), os.times()
    subprocess.run(command, env=environment, check=True, capture_output=True)
    after = os.times()
    cpu = sum(getattr(after, k) - getattr(before, k) for k in ("children_user", "children_system"))
    return {"seconds": time.perf_counter() - wall, "cpu_seconds": cpu}


def _options(project: Path, output: Path, estimator: str) -> list[str]:
    given = {"--estimator": estimator, "--preset": "full", "--texture-size": str(TINY_SIZE)}
    return [str(project), "-o", str(output), *(word for each in given.items() for word in each)]


def list_kernels(project: str, output: str) -> dict[str, Any]:
    """What the interpreter asks of numba in a run, kept from another run or not, on one core."""
    from typer.testing import CliRunner

    from ..cli import app

    found: list[Any] = []
    asked: list[Any] = []
    compile_it = Dispatcher.compile

    def note(kernel: Any, arguments: Any) -> Any:
        if not asked:  # else it is for that kernel
            found.append(to_json(kernel, arguments))
        asked.append(kernel)
        try:
            return compile_it(kernel, arguments)
        finally:
            asked.pop()

    words = ["run", *_options(Path(project), Path(output), "joint")]
    with patch.object(Dispatcher, "compile", note):
        CliRunner().invoke(app, words, catch_exceptions=False)
    return {"kernels": found}


def main() -> None:
    from ..kernel_list import LIST
    from .machine import measure

    with tempfile.TemporaryDirectory(prefix="svbrdf-kernels-") as place:
        project = make_workload(Path(place), TINY_FRAMES, TINY).project
        told = measure("list", 1, project=str(project), output=f"{place}/out")["kernels"]
    lines = ",\n".join(json.dumps(entry) for entry in told)
    Path(str(LIST)).write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    print(f"{len(told)} kernels", file=sys.stderr)


if __name__ == "__main__":
    main()
