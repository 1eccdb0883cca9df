"""How near results come to the truth, for how much time, and what each idea buys.

    pip install 'meshlab-svbrdf[benchmark,docs]'
    python -m benchmarks                          two small scenes, a few minutes
    python -m benchmarks accuracy [--scene NAME …] [--peers]
    python -m benchmarks time | ablation | photographs
    python -m benchmarks photographs RESULT.mlp   of a run with --hold-out
    python -m benchmarks performance              run time, and others at the same work
    python -m benchmarks registration             cameras of films and photographs
    python -m benchmarks export                   what other programs show of a result
    python -m benchmarks relighting               other light, and the time of a picture
    python -m benchmarks stability [--scene extremes|files|guards|…]
    python -m benchmarks materials [--scene …]    areas of one material, found and edited by hand
    python -m benchmarks microfacets              rough plastic and gold of known roughness
    python -m benchmarks hdr                      8 bits, 16, floats, brackets
    python -m benchmarks sequences                few photographs or many small frames
    python -m benchmarks page                     how long the page of `view` lets one wait
    python -m benchmarks cluster                  workers, bytes moved, 10,000 objects on paper
    python -m benchmarks --all --docs             everything, into the documentation

Scenes are rendered once into the cache. Every row is kept in --out as soon as it is there; the same
command goes on after an interruption, and measures again what older code made.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.threads import quieten_blas

from . import (
    ablation,
    accuracy,
    cluster,
    export,
    hdr,
    materials,
    microfacets,
    page,
    performance,
    photographs,
    registration,
    relighting,
    sequences,
    timing,
)
from .cases import LONG, PHOTOGRAPHS, SAMPLE, Case, available, why_not
from .documents import write_documents
from .ledger import Ledger, Row, Task
from .scenes.catalogue import COMPARED
from .scenes.make import cache_folder
from .solve import warm_up
from .stability import part as stability

SLOW = "mitsuba"  # this peer is compared over time, on one scene
_PARTS = (
    accuracy, timing, ablation, photographs, performance, registration, export, relighting,
    stability, materials, microfacets, page, hdr, cluster, sequences,
)  # fmt: skip
PARTS = {part.PART: part for part in _PARTS}


def main() -> None:
    quieten_blas()
    arguments = _arguments()
    if arguments.result:
        judge = time_page if arguments.part == page.PART else judge_result
        judge(arguments.result)
        return
    ledger = Ledger(arguments.out, arguments.old, lambda line: print(line, file=sys.stderr))
    try:
        tasks, notes = wanted(arguments, ledger)
        for note in notes:
            print(note, file=sys.stderr)
        if any(task.part != stability.PART for task in ledger.todo(tasks)):
            warm_up(ledger.work / "warm_up")
        rows = ledger.rows(tasks)
    finally:
        ledger.finish()
    show(rows)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))
    if arguments.docs:
        write_documents({part: [r for r in rows if r["part"] == part] for part in PARTS})
    failed = [row for row in rows if "error" in row]
    for row in failed:
        print(f"failed: {row['scene']}, {row['name']}: {row['error']}", file=sys.stderr)
    sys.exit(1 if failed else 0)


def wanted(arguments: argparse.Namespace, ledger: Ledger) -> tuple[list[Task], list[str]]:
    """What is to be measured, and what of it cannot be."""
    parts = list(PARTS) if arguments.all else [arguments.part] if arguments.part else []
    size, peers = arguments.texture_size, arguments.peers
    tasks: list[Task] = []
    notes: list[str] = []

    def cases(names: Sequence[str]) -> list[Case]:
        found, missing = available(arguments.scene or names, arguments.cache)
        notes.extend(missing)
        return found

    if not parts:
        tasks += accuracy.tasks(ledger, cases(accuracy.SMALL), size or 256, ())
    if accuracy.PART in parts:
        every = [*COMPARED, LONG]
        quick = [name for name in peers if name != SLOW]
        tasks += accuracy.tasks(ledger, cases(every), size or 512, quick)
    if timing.PART in parts:
        for case in cases(["floods_concave" if why_not(LONG) else LONG]):
            tasks += timing.tasks(ledger, case, size or 512, peers, arguments.minutes)
    if ablation.PART in parts:
        tasks += ablation.tasks(ledger, arguments.cache, size or 512, arguments.scene)
    if photographs.PART in parts:
        tasks += photographs.tasks(ledger, cases([PHOTOGRAPHS]), size)
    if performance.PART in parts:
        found, missing = performance.tasks(arguments.frames, size or 1024, arguments.cache)
        tasks += found
        notes.extend(missing)
    if registration.PART in parts:
        found_cases = cases([LONG, PHOTOGRAPHS])
        films = [case for case in found_cases if case.name != PHOTOGRAPHS]
        stills = [case for case in found_cases if case.name == PHOTOGRAPHS]
        tasks += registration.tasks(films, stills, arguments.cache)
    if export.PART in parts:
        sample = export.Sample("totem", arguments.cache)
        others = cases([LONG]) if arguments.scene != [sample.name] else []
        found, missing = export.tasks(ledger, [sample, *others], size or 512, arguments.cache)
        tasks += found
        notes.extend(missing)
    if relighting.PART in parts:
        tasks += relighting.tasks(ledger, cases([LONG]), size or 1024, arguments.cache)
    if stability.PART in parts:
        films, missing = available(stability.FILMS, arguments.cache)
        tasks += stability.tasks(arguments.scene, films)
        if not arguments.scene or stability.HONEST in arguments.scene:
            notes.extend(missing)
    if materials.PART in parts:
        tasks += materials.tasks(ledger, cases([SAMPLE, *COMPARED, LONG]), size or 512)
    if microfacets.PART in parts:
        tasks += microfacets.tasks(ledger, cases(microfacets.FILMS), size or 512)
    if hdr.PART in parts:
        tasks += hdr.tasks(ledger, arguments.cache)
    if sequences.PART in parts:
        films = sequences.cases(cases([LONG]), arguments.cache)
        tasks += sequences.tasks(films, size or 512)
    if page.PART in parts:
        found, missing = page.tasks(
            min(arguments.frames, page.FRAMES), size or page.TEXELS, arguments.cache
        )
        tasks += found
        notes.extend(missing)
    if cluster.PART in parts:
        found, missing = cluster.tasks(arguments.frames, size or 1024, arguments.cache)
        tasks += found
        notes.extend(missing)
    return tasks, list(dict.fromkeys(notes))


def show(rows: Sequence[Row]) -> None:
    console = Console(width=None if sys.stdout.isatty() else 220)
    for name, part in PARTS.items():
        own = [row for row in rows if row["part"] == name]
        for table in part.tables(own) if own else []:
            console.print(table.rich())


def judge_result(path: Path) -> None:
    """Print how a result of the user's own predicts the frames held out from it."""
    try:
        row = {"scene": path.stem, "name": ""} | photographs.predict(Document.open(path))
    except SvbrdfError as error:
        raise SystemExit(f"Error: {error}") from None
    for table in photographs.tables([row]):
        Console().print(table.rich())


def time_page(path: Path) -> None:
    """Print how long the page of a result of the user's own, a copy of it, lets one wait."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            copy = Document.open(path)
            copy.move_to(Path(folder) / path.name, link=True)
            copy.save()
            row = page.measure(copy.path, not page.why_no_browser())
    except SvbrdfError as error:
        raise SystemExit(f"Error: {error}") from None
    for table in page.tables([row]):
        Console().print(table.rich())


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("part", nargs="?", choices=list(PARTS))
    parser.add_argument(
        "result", nargs="?", type=Path, help="a result to judge (photographs, page)"
    )
    parser.add_argument("--all", action="store_true", help="every part")
    parser.add_argument("--scene", action="append", default=[], metavar="NAME")
    parser.add_argument("--texture-size", type=int, help="of all runs, where a part has no own")
    parser.add_argument("--peers", nargs="*", default=(), metavar="NAME",
                        help="compare with these methods too; without names, with all")  # fmt: skip
    parser.add_argument("--minutes", type=float, default=10, help="of Mitsuba's inverse rendering")
    parser.add_argument("--frames", type=int, default=300, help="of the performance workload")
    parser.add_argument("--cache", type=Path, default=cache_folder(), help="of rendered scenes")
    parser.add_argument("--out", type=Path, default=Path("benchmark_results"))
    parser.add_argument("--json", type=Path, help="write all rows to one file")
    parser.add_argument(
        "--docs", action="store_true", help="write tables and plot into docs/ and README.md"
    )
    old = parser.add_mutually_exclusive_group()
    old.add_argument("--force", dest="old", action="store_const", const="force",
                     help="measure everything again")  # fmt: skip
    old.add_argument("--keep", dest="old", action="store_const", const="keep",
                     help="take rows that older code made")  # fmt: skip
    parser.set_defaults(old="again")
    arguments = parser.parse_args()
    judging = (photographs.PART, page.PART)
    if arguments.result and arguments.part not in judging:
        parser.error(f"only {' and '.join(judging)} judge a result")
    if arguments.peers == []:
        from .peers import PEERS  # some need packages that the rest does not

        arguments.peers = list(PEERS)
    return arguments


if __name__ == "__main__":
    main()
