"""Rough plastic and gold whose truth is known: what is found, and what Phong's lobe makes of them.

Rendered by Mitsuba with Beckmann's and with GGX's distribution. The materials' borders are given,
so that errors are the fit's alone. Roughness is compared as seen: the lamps' size widens it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.samples.luminance import luminance

from .cases import Case
from .ledger import Ledger, Row, Task
from .scenes.catalogue import SCENES
from .scenes.score import DIVISOR, seen_lobes
from .scenes.variant import Material
from .solve import Setup, judge, solve
from .tables import Column, Table, table

PART = "microfacets"
FILMS = ("plastic", "gold", "ggx")
WAYS = {"microfacets": "auto", "Phong's lobe": "phong"}
OPTION = "compute_svbrdf_material_specular.reflectance"
# What Mitsuba mirrors along the normal: an index of refraction of 1.49, and gold
PLASTIC_F0, GOLD_F0 = (0.0387, 0.0387, 0.0387), (0.967, 0.802, 0.324)

FOUND = (
    Column("distribution", "true_model"),
    Column("found", "model"),
    Column("roughness", "true_roughness", "{:.3f}"),
    Column("found", "roughness", "{:.3f}"),
    Column("F₀", "true_f0", "{:.2f}"),
    Column("found", "f0", "{:.2f}"),
    Column("ln k F₀", "ln_facing", "{:+.3f}"),
    Column("colour off", "color_off", "{:.3f}"),
    Column("dB better", "gain_db", "{:.1f}"),
)
VIEWS = (
    Column("light °", "light_deg", "{:.2f}"),
    Column("worst", "light_deg_max", "{:.2f}"),
    Column("views dB", "psnr", "{:.1f}"),
    Column("worst", "psnr_worst", "{:.1f}"),
    Column("highlights dB", "psnr_highlights", "{:.1f}"),
    Column("views ΔE", "dE_views", "{:.2f}"),
)


def tasks(ledger: Ledger, cases: Sequence[Case], texture: int) -> list[Task]:
    """Both ways on every film."""
    about = f"{texture} texels"
    return [
        Task(PART, case.name, name, about, partial(_measure, ledger, case, texture, way))
        for case in cases
        for name, way in WAYS.items()
    ]


def _measure(ledger: Ledger, case: Case, texture: int, way: str, folder: Path) -> Row:
    plain = Setup(texture=texture, true_materials=True)
    base = solve(case, plain, ledger.work / PART / case.name)
    setup = Setup(texture=texture, true_materials=True, settings={OPTION: way})
    solved = solve(case, setup, folder, base.document.path.parent)
    return judge(case, solved, folder) | {"found": _found(solved.document.folder, case)}


def _found(result: Path, case: Case) -> list[Row]:
    """Truth, as under these lamps, and estimate of each material with gloss."""
    told = {m["id"]: m for m in json.loads((result / "materials.json").read_text())["materials"]}
    emitters = json.loads((case.truth / "lights.json").read_text())["emitters"]
    size = np.mean([np.radians(e["half_extent_deg"]) ** 2 / DIVISOR[e["kind"]] for e in emitters])
    _, gain = seen_lobes(case.truth)
    rows: list[Row] = []
    for index, material in enumerate(SCENES[case.name].materials):
        if material.rho_s == 0:
            continue
        better = told[index].get("reflectance")
        row: Row = {
            "scene": case.name, "name": material.name, "true_model": "phong",
            "model": better["model"] if better else "phong",
        }  # fmt: skip
        rows.append(row)
        if material.rho_s is not None:
            continue
        roughness, reflected = _truth(material)
        f0 = float(luminance(np.array(reflected)))
        # A mirror direction turns twice as far as a microfacet, whose variance is roughness²/2
        seen = math.sqrt(roughness**2 + size / 2)
        row |= {"true_model": material.distribution, "true_roughness": seen, "true_f0": f0}
        if better:
            # A lamp of intensity 1 has π on a surface that faces it
            facing = better["strength"] * better["f0"] / (np.pi * f0 * gain)
            off = np.abs(np.array(better["color"]) - np.array(reflected) / f0).max()
            row |= {key: better[key] for key in ("roughness", "f0", "gain_db")}
            row |= {"ln_facing": math.log(facing), "color_off": off}
    return rows


def _truth(material: Material) -> tuple[float, tuple[float, float, float]]:
    """Roughness, and what is mirrored along the normal, RGB."""
    if material.plastic is not None:
        return material.plastic, PLASTIC_F0
    assert material.gold is not None
    return material.gold, GOLD_F0


def tables(rows: Sequence[Row]) -> list[Table]:
    found = [each for row in rows if row["name"] == "microfacets" for each in row.get("found", [])]
    note = (
        "Left of each `found` is the truth, its roughness widened by the lamps' size. k F₀ is what "
        "is mirrored along the normal, found over true; its colour, at luminance 1, is off by at "
        "most so much in a channel; dB: by how much unseen samples are predicted better."
    )
    views = "Over six views that no frame has; highlights: their brightest tenth."
    return [
        table("Microfacets, true and found", found, FOUND, note),
        table("Unseen views, with microfacets and with Phong's lobe alone", rows, VIEWS, views),
    ]
