"""How near both estimators come to the truth, scene by scene.

Both run as a user would run them, and once more with the true segmentation. `truth` is the truth's
own maps rendered as results are: what the dB can reach. Peers use the same frames and texels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from .cases import Case
from .ledger import Ledger, Row, Task
from .scenes.ceiling import render_truth
from .scenes.score import unseen_views
from .scenes.score_environment import environment_picture
from .solve import Setup, judge, solve
from .summary import sentences
from .tables import Column, Table, table

PART = "accuracy"
SMALL = ("floods_convex", "floods_concave")
PEERS = ("mean", "median", "quantile")

LIGHT = (
    Column("light °", "light_deg", "{:.2f}"),
    Column("worst", "light_deg_max", "{:.2f}"),
    Column("missed", "lights_missed"),
    Column("false", "lights_false"),
    Column("ln gain", "ln_gain_max", "{:.3f}"),
    Column("energy inside", "env_energy_inside", "{:.0%}"),
    Column("sr outside", "env_outside_sr", "{:.2f}"),
)
MATERIAL = (
    Column("ln ρs", "ln_rho_s_worst", "{:+.3f}"),
    Column("ln α", "ln_alpha_worst", "{:+.3f}"),
    Column("clusters", "clusters"),
    Column("labelled", "labelled", "{:.3f}"),
    Column("Rand", "adjusted_rand", "{:.2f}"),
)
DIFFUSE = (
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("median", "dE_median", "{:.2f}"),
    Column("95 %", "dE_p95", "{:.2f}"),
    Column("coverage", "coverage", "{:.3f}"),
)
VIEWS = (
    Column("dB", "psnr", "{:.1f}"),
    Column("worst", "psnr_worst", "{:.1f}"),
    Column("highlights", "psnr_highlights", "{:.1f}"),
    Column("inner", "psnr_inner", "{:.1f}"),
    Column("SSIM", "ssim", "{:.3f}"),
    Column("of highlights", "ssim_highlights", "{:.3f}"),
)
SECONDS = (Column("s", "seconds", "{:.0f}"),)


def tasks(
    ledger: Ledger, cases: Sequence[Case], texture: int, peers: Sequence[str] = PEERS
) -> list[Task]:
    """The rows of every scene."""
    ways = {
        "joint": Setup(texture=texture),
        "joint, true materials": Setup(texture=texture, true_materials=True),
        "paper": Setup("paper", texture=texture),
    }
    found = []
    for case in cases:
        own: dict[str, Callable[[Path], Row]] = {"truth": partial(_truth, case, texture)}
        for name, setup in ways.items():
            own[name] = partial(_estimate, ledger, case, name, setup)
        for name in peers:
            own[name] = partial(_peer, ledger, case, name, texture)
        about = f"{texture} texels"
        found += [Task(PART, case.name, name, about, make) for name, make in own.items()]
    return found


def _base(ledger: Ledger, case: Case, texture: int):
    """The plain result that the others go on from."""
    return solve(case, Setup(texture=texture), ledger.work / PART / "base" / case.name)


def _estimate(ledger: Ledger, case: Case, name: str, setup: Setup, folder: Path) -> Row:
    assert setup.texture is not None
    base = _base(ledger, case, setup.texture)
    solved = base if name == "joint" else solve(case, setup, folder, base.document.path.parent)
    figures = judge(case, solved, folder)
    picture = (
        ledger.folder / "pictures" / f"{case.name}.{name.replace(', ', '_').replace(' ', '_')}.png"
    )
    if "env_energy_inside" in figures:
        environment_picture(solved.document.folder, case.truth, picture)
    return figures


def _truth(case: Case, texture: int, folder: Path) -> Row:
    if not case.phong:
        return {"skipped": "the truth is no Phong lobe"}
    render_truth(case.truth, folder / "views", texture)
    return unseen_views(folder / "views", case.truth)


def _peer(ledger: Ledger, case: Case, name: str, texture: int, folder: Path) -> Row:
    from .peers import peer_scores  # some need packages that the rest does not

    result = _base(ledger, case, texture).document.folder
    return peer_scores(case.path, result, case.truth, texture, folder, [name])[name]


def tables(rows: Sequence[Row]) -> list[Table]:
    rows = [row for row in rows if "skipped" not in row]
    ours = [row for row in rows if row["name"].startswith(("joint", "paper"))]
    return [
        Table("In short", ["`joint`, over all scenes"], [[text] for text in sentences(rows)]),
        table("Lights, environment map and materials", ours, LIGHT + MATERIAL),
        table("Diffuse colour and unseen views", rows, DIFFUSE + VIEWS + SECONDS),
    ]
