"""Damage that follows the parsers' branches: coverage-guided fuzzing by atheris, where it is.

    pip install atheris                              Linux, CPython 3.11 to 3.13
    python -m benchmarks.stability.guided .mlp [--minutes 2] [--seed 1]
    python -m benchmarks.stability.guided all

A format's good file and its seeded damages are where it begins. What breaks is as for the seeded
files of `python -m benchmarks stability --scene files`: any exception but the suite's own, ten
seconds, a refusal that changes a file. The first that breaks is told and ends the run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from itertools import islice
from pathlib import Path

BEGIN = 100  # damaged files to begin with


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("format", help="as in the table of damaged files, or all")
    parser.add_argument("--minutes", type=float, default=2.0, help="of each format")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if arguments.format == "all":
        sys.exit(_all(arguments))
    _fuzz(arguments)


def _all(arguments: argparse.Namespace) -> int:
    """Every format in a process of its own, for the fuzzer ends with it; how many broke."""
    from .files import formats

    with tempfile.TemporaryDirectory() as folder:
        names = [each.name for each in formats(Path(folder) / "files")]
    options = ["--minutes", str(arguments.minutes), "--seed", str(arguments.seed)]
    command = [sys.executable, "-m", "benchmarks.stability.guided"]
    return sum(subprocess.run([*command, name, *options]).returncode != 0 for name in names)


def _fuzz(arguments: argparse.Namespace) -> None:
    import atheris

    os.environ["NUMBA_DISABLE_JIT"] = "1"  # instrumented code is no kernel

    with atheris.instrument_imports(include=["meshlab_svbrdf"]):
        from .files import formats
        from .hostile import SECONDS, snapshot
    from meshlab_svbrdf.errors import SvbrdfError

    from .damage import damaged

    place = Path(tempfile.mkdtemp())
    found = {each.name: each for each in formats(place / "files")}
    if arguments.format not in found:
        raise SystemExit(f"{arguments.format}: expected one of {', '.join(found)}")
    each = found[arguments.format]
    good = each.path.read_bytes()
    corpus = place / "corpus"
    corpus.mkdir()
    begin = islice(damaged(good, arguments.seed, each.text), BEGIN)
    for index, data in enumerate([good, *begin]):
        (corpus / f"{index}").write_bytes(data)
    counts = {"read": 0, "refused": 0}

    def read_one(data: bytes) -> None:
        each.path.write_bytes(data)
        before = snapshot(place / "files")
        try:
            each.read(each.path)
            counts["read"] += 1
        except SvbrdfError as error:
            counts["refused"] += 1
            if each.path.name not in str(error) and str(place) not in str(error):
                raise RuntimeError(f"does not name the file: {error}") from error
            if snapshot(place / "files") != before:
                raise RuntimeError(f"refused, but changed files: {error}") from error
        if sum(counts.values()) % 100 == 0:
            (place / "counts").write_text(f"{counts['read']} read, {counts['refused']} refused")

    quiet = ["-verbosity=0", "-print_final_stats=0", f"-artifact_prefix={place}/"]
    limits = [f"-max_total_time={int(60 * arguments.minutes)}", f"-timeout={SECONDS}",
              f"-seed={arguments.seed}", f"-max_len={max(4 * len(good), 4096)}"]  # fmt: skip
    sys.stdout.flush()
    process = os.fork()
    if process == 0:
        atheris.Setup([sys.argv[0], *quiet, *limits, str(corpus)], read_one)
        atheris.Fuzz()
    _, status = os.waitpid(process, 0)
    told = (place / "counts").read_text() if (place / "counts").exists() else "too few to tell"
    print(f"{each.name}: {told}; {'broke, see above' if status else 'nothing broke'}", flush=True)
    sys.exit(1 if status else 0)


if __name__ == "__main__":
    main()
