"""The part `stability` of the benchmarks: its rows, and their tables in docs/stability.md."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from ..cases import LONG, PHOTOGRAPHS, SAMPLE, Case
from ..ledger import Row, Task
from ..tables import Table
from . import chain, lamps, precision, stages, statistics
from .checks import Check, run_cases
from .guards import try_guards
from .handmade import try_handmade
from .honest import judge_film, judge_gloss
from .hostile import try_formats
from .interruption import fill_disks, kill_runs, limit_memory

PART = "stability"
EXTREMES, FILES, GUARDED, INTERRUPTED = "extremes", "files", "guards", "interrupted"
HONEST, FILMS = "honest", (SAMPLE, LONG, PHOTOGRAPHS)
SWEEPS: dict[str, ModuleType] = {
    "sums": statistics, "single precision": precision, "each stage": stages,
    "lights and gloss": lamps,
    "the chain": chain,
}  # fmt: skip
DAMAGED, KILLS, DISKS = 200, 200, 60
MEGABYTES = (100, 1000, 1500, 1550, 1600, 1700, 1850, 2000)


def tasks(only: Sequence[str] = (), films: Sequence[Case] = ()) -> list[Task]:
    """All of them, or those of some groups: extremes, files, guards, interrupted, honest.

    films : of `FILMS`, those that are here
    """
    found = [
        Task(PART, EXTREMES, name, "", partial(_sweep, name, module))
        for name, module in SWEEPS.items()
    ]
    found += [
        Task(PART, FILES, "damaged", f"{DAMAGED} of each format", _damaged),
        Task(PART, FILES, "made to do harm", "", _handmade),
        Task(PART, GUARDED, "guards", "", _guarded),
        Task(PART, INTERRUPTED, "killed", f"{KILLS} times", partial(_disturbed, kill_runs, KILLS)),
        Task(PART, INTERRUPTED, "disk full", f"{DISKS} sizes",
             partial(_disturbed, fill_disks, DISKS)),
        Task(PART, INTERRUPTED, "memory", f"{len(MEGABYTES)} limits", _limited),
        *[Task(PART, HONEST, film.name, "", partial(_honest, film)) for film in films],
        Task(PART, HONEST, "gloss", ", ".join(film.name for film in films),
             partial(_gloss, films)),
    ]  # fmt: skip
    return [task for task in found if not only or task.scene in only]


def _sweep(name: str, module: ModuleType, folder: Path) -> Row:
    folder.mkdir(parents=True)
    checks = run_cases(name, module.cases(folder))
    return _row({"checks": [asdict(check) for check in checks]},
                [f"{c.case}: {c.broke or c.error}" for c in checks if not c.ok])  # fmt: skip


def _damaged(folder: Path) -> Row:
    folder.mkdir(parents=True)
    rows = try_formats(folder / "files", DAMAGED)
    return _row({"formats": rows}, [f"{r['format']}: {how}" for r in rows for how in r["how"]])


def _handmade(folder: Path) -> Row:
    folder.mkdir(parents=True)
    cases = try_handmade(folder)
    told = [{"case": name, "said": said} for name, said, _ in cases]
    return _row({"cases": told}, [f"{name}: {broke}" for name, _, broke in cases if broke])


def _guarded(folder: Path) -> Row:
    rows = try_guards(folder)
    return _row({"guards": rows}, [f"{r['guard']}: {r['broke']}" for r in rows if r["broke"]])


def _disturbed(disturb: Callable[[Path, int], dict[str, Any]], count: int, folder: Path) -> Row:
    folder.mkdir(parents=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks where threads have run
        row = disturb(folder, count)
    return _row(row, row["broke"])


def _limited(folder: Path) -> Row:
    folder.mkdir(parents=True)
    row = limit_memory(folder, MEGABYTES)
    broke = [f"{r['megabytes']} MB: {how}" for r in row["memory"] for how in r["broke"]]
    return _row(row, broke)


def _honest(film: Case, folder: Path) -> Row:
    folder.mkdir(parents=True)
    row = judge_film(film, folder)
    return _row(row, [f"{r['change']}: {why}" for r in row["changes"] for why in r["broke"]])


def _gloss(films: Sequence[Case], folder: Path) -> Row:
    folder.mkdir(parents=True)
    row = judge_gloss(films, folder)
    return _row(row, [f"{r['film']}: {r['broke']}" for r in row["gloss"] if r["broke"]])


def _row(row: Row, broke: Sequence[str]) -> Row:
    return row | ({"error": f"{len(broke)} broke: {'; '.join(broke)[:2000]}"} if broke else {})


# Tables


def tables(rows: Sequence[Row]) -> list[Table]:
    found: list[Table] = []
    for row in rows:
        if "checks" in row:
            found.append(_extremes(row))
        elif "formats" in row:
            found.append(_formats(row))
        elif "cases" in row:
            found.append(_cases(row))
        elif "guards" in row:
            cells = [[r["guard"], f"`{r['test']}`", r["broke"] or "yes"] for r in row["guards"]]
            headings = ["guard", "test", "fails without it"]
            found.append(Table(f"{len(cells)} guards", headings, cells))
        elif "stages" in row:
            found.append(_kills(row))
        elif "told" in row:
            found.append(_disks(row))
        elif "memory" in row:
            cells = [[f"{r['megabytes']:,}", _short(r["said"].partition(": ")[2]) if r["said"] else
                      "goes on to its end"] for r in row["memory"]]  # fmt: skip
            found.append(Table("Limited memory", ["MB of address space", "the run"], cells))
        elif "changes" in row:
            found.append(_changes(row))
        elif "gloss" in row:
            found.append(_glosses(row))
        else:
            found.append(Table(f"{row['name']}: failed", ["error"], [[row.get("error", "")]]))
    return found


def _extremes(row: Row) -> Table:
    checks = [Check(**check) for check in row["checks"]]
    cells = [
        [c.case, c.what] + ([_short(c.said or c.broke), ""] if c.said or c.broke
                            else [f"{c.error:.1e}" if c.error else "0", f"{c.bound:.1e}"])
        for c in checks
    ]  # fmt: skip
    held = sum(c.ok for c in checks)
    return Table(
        f"{row['name']}: {held} of {len(checks)} within their bounds, or told",
        ["case", "error of", "error, or what is said", "bound"], cells,
    )  # fmt: skip


def _short(said: str) -> str:
    """What a message says, without the folder of this run."""
    text = re.sub(r"/(?:[^/\s]+/)+", "", " ".join(said.split()))
    return f"“{text[:110]}{'…' if len(text) > 110 else ''}”"


def _formats(row: Row) -> Table:
    rows = row["formats"]
    cells = [[r["format"], *(f"{r[k]:,}" for k in ("tried", "read", "refused", "broke"))]
             for r in rows]  # fmt: skip
    cells.append(["all", *(f"{sum(r[k] for r in rows):,}"
                           for k in ("tried", "read", "refused", "broke"))])  # fmt: skip
    return Table("Damaged files", ["format", "tried", "read", "refused", "broke"], cells)


def _cases(row: Row) -> Table:
    cells = [[case["case"], _short(case["said"].rpartition("Error: ")[2])] for case in row["cases"]]
    return Table(f"{len(cells)} files made to do harm", ["file", "what is said"], cells)


def _kills(row: Row) -> Table:
    cells = [[stage, str(count)] for stage, count in row["stages"].items()]
    cells.append(["all", str(row["kills"])])
    return Table(
        "Killed without warning", ["while it ran", "kills"], cells,
        (f"{row['finished']} times the run went on to its end; {len(row['broke'])} broke.",),
    )  # fmt: skip


def _disks(row: Row) -> Table:
    cells = [[str(row[key]) for key in ("tried", "told", "enough")] + [str(len(row["broke"]))]]
    return Table("Files that may not grow", ["runs", "told", "had room", "broke"], cells)


def _changes(row: Row) -> Table:
    columns = (("pixels", ".1f"), ("agreement", ".2f"), ("spread", ".3f"), ("sides", ".3f"),
               ("turns", ".3f"))  # fmt: skip
    cells = [
        [r["change"], *("" if r[key] is None else f"{r[key]:{form}}" for key, form in columns),
         ", ".join(r["told"]) or "nothing"]
        for r in row["changes"]
    ]  # fmt: skip
    headings = ["what was done", "outline off, pixels", "agreement", "gains' spread",
                "sides' change", "turns' change", "what is told"]  # fmt: skip
    return Table(row["name"], headings, cells)


def _glosses(row: Row) -> Table:
    cells = [[r["film"], f"{r['observed']} of {r['materials']}", "; ".join(r["reasons"])]
             for r in row["gloss"]]  # fmt: skip
    return Table("Gloss", ["film", "materials whose gloss is observed", "why not"], cells)
