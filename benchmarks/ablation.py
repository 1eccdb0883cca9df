"""What each idea buys: every option alone, against the result with the defaults.

A row goes on from the default result: only the filters that the option concerns run again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from .cases import LONG, Case, why_not
from .ledger import Ledger, Row, Task
from .solve import Setup, judge, solve
from .tables import Column, Table, table

PART = "ablation"
CONCAVE = "floods_concave"
BASE = "defaults"

SAMPLES = "compute_svbrdf_samples"
VISIBILITY = "compute_svbrdf_visibility"
ENVIRONMENT = "generate_svbrdf_environment_map"
DIFFUSE = "compute_svbrdf_diffuse_color"
LIGHTS = "compute_svbrdf_light_sources"
PEAKS = "compute_svbrdf_texel_specular"
MATERIALS = "compute_svbrdf_materials"
GLOSS = "compute_svbrdf_material_specular"


@dataclass(frozen=True)
class Change:
    """One option against the default.

    name : what changes; settings : FILTER.NAME=VALUE, separated by spaces
    scenes : where it is measured, in place of the common ones
    """

    name: str
    settings: str
    scenes: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, str]:
        return dict(text.split("=", 1) for text in self.settings.split())


PAPER = (  # docs/paper.md's table of where `paper` is not the letter, and what its stages could be
    Change("q < 0.1 dropped for t alone", f"{SAMPLES}.minimum_quality=0"),
    Change("map divided by the count", f"{ENVIRONMENT}.normalisation=count"),
    Change("map scaled by its maximum", f"{ENVIRONMENT}.scale=max"),
    Change("Gaussian on the dot product", f"{DIFFUSE}.cone_kernel=literal"),
    Change("weights s, not 1 − s", f"{DIFFUSE}.weights=s"),
    Change("V(ω) for each of 16 directions", f"{DIFFUSE}.cone_visibility=true"),
    Change("c_min the least of the peak", f"{PEAKS}.c_min=least"),
    Change("p the farthest of the ellipse", f"{PEAKS}.p=farthest"),
    Change("density of ρs, not of ln ρs", f"{GLOSS}.density=linear"),
    Change("mean in the bell, not median", f"{GLOSS}.bell=mean"),
    Change("faint blobs are lights too", f"{LIGHTS}.minimum_energy=0"),
    Change("lights by peaks", f"{LIGHTS}.method=peaks"),
    Change("automatic materials", f"{MATERIALS}.image="),
    Change("… in plain CIE Lab", f"{MATERIALS}.image= {MATERIALS}.lightness_weight=1"),
)
JOINT = (
    Change("far lights", f"{GLOSS}.near=false"),
    Change("compact lamps", f"{GLOSS}.long=false", ("tubes",)),
    Change("clipped samples dropped", f"{GLOSS}.censoring=false"),
    Change("curved texels kept", f"{GLOSS}.curvature=0"),
    Change("normals kept", f"{GLOSS}.normals=keep"),
    Change("normals kept", f"{GLOSS}.normals=keep", ("coarse_normals",)),
    Change("Phong's lobe alone", f"{GLOSS}.reflectance=phong", (CONCAVE, "plastic", "gold")),
    Change(
        "no lights looked for in the residuals", f"{GLOSS}.complete=false", (CONCAVE, "unequal")
    ),
    Change("the lens blurs too", f"{GLOSS}.lens=true"),
    Change("no sheen", f"{GLOSS}.sheen=none", (CONCAVE,)),
    Change("ambient highlight left in D", f"{GLOSS}.ambient=false"),
    Change("pixels' blur left in D", f"{GLOSS}.sharp=false"),
    Change("shadows by harmonics", f"{GLOSS}.shadows=harmonics"),
    Change("3 rounds", f"{GLOSS}.rounds=3"),
    Change("a third of the samples", f"{GLOSS}.samples=1000000"),
    Change("lights by median cut", f"{LIGHTS}.method=median_cut"),
    Change("no fainter lights", f"{LIGHTS}.faint=0.3", ("unequal",)),
    Change("no visibility", f"{VISIBILITY}.mode=never"),
    Change("3 bands of visibility", f"{VISIBILITY}.bands=3"),
    Change("64 rows of environment", f"{ENVIRONMENT}.height=64"),
    Change("diffuse: trimmed mean", f"{DIFFUSE}.method=trimmed"),
    Change("diffuse: low quantile", f"{DIFFUSE}.method=quantile"),
    Change("no gains per frame", f"{SAMPLES}.gains=none", ("exposure_untold",)),
    Change("automatic materials", f"{MATERIALS}.image="),
    Change("… regions not joined", f"{MATERIALS}.image= {MATERIALS}.join=false"),
)
CHANGES = {"joint": JOINT, "paper": PAPER}

COLUMNS = (
    Column("light °", "light_deg", "{:.2f}"),
    Column("ln ρs", "ln_rho_s_worst", "{:+.3f}"),
    Column("ln α", "ln_alpha_worst", "{:+.3f}"),
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("median", "dE_median", "{:.2f}"),
    Column("dB", "psnr", "{:.1f}"),
    Column("highlights", "psnr_highlights", "{:.1f}"),
    Column("against the defaults", "gain", "{:+.1f}"),
    Column("s", "seconds", "{:.0f}"),
)


def common(estimator: str) -> tuple[str, ...]:
    """Scenes of the changes that name none: two for `joint`, one for `paper`."""
    if why_not(LONG):
        return (CONCAVE,)
    return (CONCAVE, LONG) if estimator == "joint" else (LONG,)


def tasks(ledger: Ledger, cache: Path, texture: int, scenes: Sequence[str] = ()) -> list[Task]:
    """Rows of both estimators, on the scenes given, or on each change's own."""
    found = []
    for estimator, changes in CHANGES.items():
        by_scene: dict[str, list[Change]] = {}
        for change in changes:
            for scene in scenes or change.scenes or common(estimator):
                own = by_scene.setdefault(scene, [])
                if change.settings not in [other.settings for other in own]:
                    own.append(change)
        for scene, own in by_scene.items():
            case = Case(scene, cache)
            for change in (Change(BASE, ""), *own):
                make = partial(_measure, ledger, case, estimator, texture, change)
                about = f"{texture} texels, {change.settings}"
                found.append(Task(PART, scene, f"{estimator}: {change.name}", about, make))
    return found


def _measure(
    ledger: Ledger, case: Case, estimator: str, texture: int, change: Change, folder: Path
) -> Row:
    """With the true materials, so that a change of the segmentation hides nothing."""
    base = solve(
        case, Setup(estimator, texture=texture, true_materials=True),
        ledger.work / PART / f"{case.name}.{estimator}",
    )  # fmt: skip
    setup = Setup(estimator, texture=texture, true_materials=True, settings=change.parameters)
    solved = solve(case, setup, folder, base.document.path.parent) if change.settings else base
    return judge(case, solved, folder) | {"change": change.settings}


def tables(rows: Sequence[Row]) -> list[Table]:
    """A table for each estimator and scene."""
    made = []
    for estimator in CHANGES:
        own = [row for row in rows if row["name"].startswith(f"{estimator}: ")]
        for scene in dict.fromkeys(row["scene"] for row in own):
            here = [row for row in own if row["scene"] == scene]
            plain = next((r for r in here if r["name"].endswith(f": {BASE}")), {})
            shown = []
            for row in here:
                high, before = row.get("psnr_highlights"), plain.get("psnr_highlights")
                gain = None if high is None or before is None else high - before
                name = row["name"].removeprefix(f"{estimator}: ")
                option = (
                    row.get("change", "")
                    .replace("compute_svbrdf_", "")
                    .replace("generate_svbrdf_", "")
                )
                shown.append(row | {"name": f"{name} ({option})" if option else name, "gain": gain})
            made.append(table(f"{estimator} on {scene}", shown, COLUMNS, scene=False))
    return made
