"""Tables and plot of the benchmark in the documentation, so that every figure is a command's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from meshlab_svbrdf.presets import PRESETS

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
from .ledger import ROOT, Row
from .plot import time_plot
from .sequences_plot import sequences_plot
from .stability import part as stability
from .tables import Column, Table, splice, table

PAGE, README = ROOT / "docs" / "accuracy.md", ROOT / "README.md"
SPEED, CAMERAS = ROOT / "docs" / "performance.md", ROOT / "docs" / "registration.md"
RELIT = {"relighting": ROOT / "docs" / "albedo.md", "rendering": ROOT / "docs" / "rendering.md"}
STABILITY = ROOT / "docs" / "stability.md"
HDR = ROOT / "docs" / "hdr.md"
GLOSS = ROOT / "docs" / "material_specular.md"
MATERIALS, VIEW = ROOT / "docs" / "materials.md", ROOT / "docs" / "view.md"
PICTURE = ROOT / "docs" / "images" / "accuracy_time.png"
SCALING = ROOT / "docs" / "scaling.md"
EXPORT = ROOT / "docs" / "export.md"
EXPORT_PICTURE = ROOT / "docs" / "images" / "export.png"
SEQUENCES = ROOT / "docs" / "sequences.md"
SEQUENCES_PICTURE = ROOT / "docs" / "images" / "sequences.png"
PARTS = (accuracy, timing, ablation, photographs)
SHORT = (
    Column("s", "seconds", "{:.0f}"),
    Column("light °", "light_deg", "{:.2f}"),
    Column("ln ρs", "ln_rho_s_worst", "{:+.3f}"),
    Column("ln α", "ln_alpha_worst", "{:+.3f}"),
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("unseen views dB", "psnr", "{:.1f}"),
    Column("highlights dB", "psnr_highlights", "{:.1f}"),
)


def write_documents(rows: Mapping[str, Sequence[Row]]) -> None:
    """Fill the parts of the pages of docs/ and of README.md that `rows` has figures for."""
    splice(PAGE, "presets", presets_table())
    for part in PARTS:
        own = rows.get(part.PART)
        if own:
            tables = part.tables(own)
            splice(PAGE, part.PART, "\n\n".join(each.markdown() for each in tables))
    if own := rows.get(export.PART):
        splice(EXPORT, export.PART, "\n\n".join(each.markdown() for each in export.tables(own)))
        export.picture(own, EXPORT_PICTURE)
    pages = (
        (materials, MATERIALS), (microfacets, GLOSS), (page, VIEW), (hdr, HDR), (cluster, SCALING),
    )  # fmt: skip
    for part, path in pages:
        if own := rows.get(part.PART):
            splice(path, part.PART, "\n\n".join(each.markdown() for each in part.tables(own)))
    if own := rows.get(performance.PART):
        text = "\n\n".join(each.markdown() for each in performance.tables(own))
        splice(SPEED, performance.PART, text)
        if paper := performance.paper_table(own):
            splice(README, performance.PART, paper.markdown())
    if own := rows.get(registration.PART):
        text = "\n\n".join(each.markdown() for each in registration.tables(own))
        splice(CAMERAS, registration.PART, text)
    if own := rows.get(relighting.PART):
        for (name, where), each in zip(RELIT.items(), relighting.tables(own), strict=False):
            splice(where, name, each.markdown())
    if own := rows.get(sequences.PART):
        text = "\n\n".join(each.markdown() for each in sequences.tables(own))
        splice(SEQUENCES, sequences.PART, text)
        sequences_plot(own, SEQUENCES_PICTURE)
    if own := rows.get(stability.PART):
        for row in own:
            text = "\n\n".join(each.markdown() for each in stability.tables([row]))
            splice(STABILITY, f"{row['scene']}, {row['name']}", text)
    measured = timing.over_time(r for r in rows.get(timing.PART, ()) if "error" not in r)
    if measured:
        time_plot(measured, PICTURE)
        splice(README, timing.PART, short_table(measured).markdown())


def presets_table() -> str:
    lines = ["| preset | for | sets |", "|---|---|---|"]
    for name, preset in PRESETS.items():
        given = ", ".join(f"`{key}={value}`" for key, value in preset.parameters.items())
        lines.append(f"| `{name}` | {preset.about} | {given or 'nothing: the defaults'} |")
    return "\n".join(lines)


def short_table(rows: Sequence[Row]) -> Table:
    """Presets, `paper` and peers: what the README shows."""
    shown = [row for row in rows if row["group"] in (timing.PRESET, timing.PAPER, timing.PEER)]
    return table(f"On {shown[0]['scene']}", shown, SHORT, scene=False)
