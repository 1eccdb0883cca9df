"""Whether other programs show what is exported as it is rendered here.

The result is exported with one lamp, opened by each program as its users would open it, rendered
from views that no frame has, and compared with `generate_svbrdf_relighting` under the same lamp.
Programs that are not there are left out.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, write_png
from meshlab_svbrdf.document.light_files import LightEntry, read_light_file
from meshlab_svbrdf.document.products import plain
from meshlab_svbrdf.document.project import RasterEntry, read_project
from meshlab_svbrdf.exporting.lights import light_file
from meshlab_svbrdf.filters.generate_svbrdf_relighting import lamps_of
from meshlab_svbrdf.rendering.environment_lights import Illumination
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from .cases import Case
from .exports import blender, node, three
from .ledger import ROOT, Ledger, Row, Task
from .solve import Setup, solve
from .tables import Column, Table, table

PART = "export"
VIEWS = 4
GREY = 118
FILES, THREE, BLENDER, MITSUBA = "files", "three.js (GLB)", "Blender (GLB)", "Mitsuba (OBJ, MTL)"
EXPORT, RELIGHT = "generate_svbrdf_export", "generate_svbrdf_relighting"
_FIVE = np.ones((5, 5), np.uint8)


@dataclass(frozen=True)
class Sample(Case):
    """The sample project."""

    @property
    def path(self) -> Path:
        return ROOT / "sample_projects" / "totem" / "totem.mlp"


@dataclass(frozen=True)
class Exported:
    """document : the result; folder : the files; lamp : the one that shines; views : the cameras"""

    document: Document
    folder: Path
    lamp: Illumination
    views: list[RasterEntry]

    @property
    def file(self) -> Path:
        """Of any format, by its suffix."""
        return self.folder / self.document.name

    def ours(self, case: Case, shadows: bool) -> list[np.ndarray]:
        """The same views rendered here, (H, W, 3) uint8."""
        folder = self.folder / f"shadows_{shadows}"
        self.document.apply(
            RELIGHT, lights=self.folder / "lamp.json", cameras=_cameras(case), folder=folder,
            shadows=shadows, background=GREY,
        )  # fmt: skip
        return [read_image(folder / view.path.name)[..., :3] for view in self.views]


def tasks(
    ledger: Ledger, cases: Sequence[Case], texture: int | None, cache: Path
) -> tuple[list[Task], list[str]]:
    """A row for each program and scene, and a line on each program that is not there."""
    lacking = {
        FILES: node.why_not(),
        THREE: node.why_not() or ("" if three.chromium() else "needs Chromium on the PATH"),
        BLENDER: blender.why_not(),
        MITSUBA: "" if importlib.util.find_spec("mitsuba") else "needs Mitsuba",
    }
    makers: dict[str, Callable[..., Row]] = {
        FILES: partial(_files, cache),
        THREE: partial(_three, cache),
        BLENDER: _blender,
        MITSUBA: _mitsuba,
    }
    found = [
        Task(PART, case.name, name, f"{texture} texels",
             partial(_measured, ledger, case, texture, name, make))
        for case in cases
        for name, make in makers.items()
        if not lacking[name]
    ]  # fmt: skip
    return found, [f"{name}: left out, {reason}" for name, reason in lacking.items() if reason]


def _measured(
    ledger: Ledger, case: Case, texture: int | None, name: str,
    make: Callable[[Case, Exported], Row], folder: Path,
) -> Row:  # fmt: skip
    exported = _exported(ledger.work / PART / case.name, case, texture)
    row = make(case, exported)
    pictures = row.pop("pictures", None)
    if pictures:
        place = ledger.folder / "pictures"
        place.mkdir(exist_ok=True)
        for who, image in zip((name, "ours"), pictures, strict=True):
            path = place / f"{PART}.{case.name}.{who.split()[0]}.png"
            write_png(path, image)
            row[f"picture_{'ours' if who == 'ours' else 'theirs'}"] = str(path)
    return row


def _exported(folder: Path, case: Case, texture: int | None) -> Exported:
    """Solve, if that is not done yet, and export under one lamp."""
    document = solve(case, Setup(texture=texture), folder).document
    document.apply("compute_svbrdf_albedo")
    files = folder / "export"
    files.mkdir(exist_ok=True)
    center, radius = document.mesh().center, float(document.array("texels_radius"))
    lamp = lamps_of(document, _one_lamp(case, document))
    told = light_file(lamp, np.zeros(3), center, radius)
    (files / "lamp.json").write_text(json.dumps(plain(told)))
    document.apply(
        EXPORT, folder=files, formats="gltf glb obj textures lights", color="albedo",
        lights=files / "lamp.json", unobserved="nearest",
    )  # fmt: skip
    return Exported(document, files, lamp, read_project(_cameras(case)).rasters[:VIEWS])


def _cameras(case: Case) -> Path:
    return case.truth / "views" / "project.mlp"


def _one_lamp(case: Case, document: Document) -> list[LightEntry]:
    """The scene's other lamp, where it has one to relight by, else the first that was found."""
    other = case.truth / "relight_single" / "lights.json"
    return read_light_file(other if other.is_file() else document.folder / "lights.json").lamps[:1]


def _files(cache: Path, case: Case, exported: Exported) -> Row:
    """What Khronos' validator says, and what the export took."""
    reports = [
        node.validated(exported.file.with_suffix(suffix), node.modules(cache))["issues"]
        for suffix in (".glb", ".gltf")
    ]
    run = exported.document.apply(
        EXPORT, folder=exported.folder / "again", formats="glb obj textures lights",
        color="albedo", force=True,
    )  # fmt: skip
    coverage = json.loads(exported.file.with_suffix(".json").read_text())["coverage"]
    size = sum(path.stat().st_size for path in (exported.folder / "again").iterdir())
    kinds = {"errors": ("Errors",), "warnings": ("Warnings",), "remarks": ("Infos", "Hints")}
    return {
        "validator": {
            word: sum(r[f"num{each}"] for r in reports for each in of) for word, of in kinds.items()
        },
        "seconds": run.seconds, "megabytes": size / 1e6, "coverage": coverage,
    }  # fmt: skip


def _three(cache: Path, case: Case, exported: Exported) -> Row:
    cameras = [view.camera for view in exported.views]
    found = three.render(exported.file.with_suffix(".glb"), cameras, node.modules(cache), GREY)
    return _judged([to_srgb8(image) for image in found], exported.ours(case, False))


def _blender(case: Case, exported: Exported) -> Row:
    cameras = [view.camera for view in exported.views]
    found = blender.render(exported.file.with_suffix(".glb"), cameras, exported.folder)
    return _judged(_on_grey(found), exported.ours(case, True))


def _mitsuba(case: Case, exported: Exported) -> Row:
    from .exports import mitsuba

    mesh = exported.document.mesh()
    found = mitsuba.render(
        exported.file.with_suffix(".obj"), exported.lamp, mesh.center, mesh.radius,
        [view.camera for view in exported.views],
    )  # fmt: skip
    return _judged(_on_grey(found), exported.ours(case, True))


def _on_grey(found: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    grey = float(decode(np.array(GREY / 255)))
    return [to_srgb8(image + grey * (1 - cover[..., None])) for image, cover in found]


def _judged(theirs: Sequence[np.ndarray], ours: Sequence[np.ndarray]) -> Row:
    """PSNR in sRGB over the object off its silhouette; highlights: its brightest tenth."""
    every, high = [], []
    for a, b in zip(theirs, ours, strict=True):
        on = (np.abs(b.astype(int) - b[0, 0]).max(-1) > 2).astype(np.uint8)
        on = cv2.erode(cv2.morphologyEx(on, cv2.MORPH_CLOSE, _FIVE), _FIVE) > 0
        square, bright = ((a.astype(float) - b) ** 2).mean(-1)[on], b.mean(-1)[on]
        every.append(_psnr(square))
        high.append(_psnr(square[bright >= np.quantile(bright, 0.9)]))
    return {
        "views": len(every), "psnr": float(np.mean(every)), "psnr_worst": float(min(every)),
        "psnr_highlights": float(np.mean(high)), "pictures": (theirs[0], ours[0]),
    }  # fmt: skip


def _psnr(square: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / max(float(square.mean()), 1e-12)))


def tables(rows: Sequence[Row]) -> list[Table]:
    """How alike the pictures are, and what the files are like."""
    files = [row for row in rows if row["name"] == FILES]
    views = [row for row in rows if row["name"] != FILES]

    def issues(row: Row) -> str:
        return ", ".join(f"{count} {kind}" for kind, count in row["validator"].items())

    def share(key: str) -> Callable[[Row], float]:
        return lambda row: 100 * row["coverage"][key]

    found = []
    if views:
        columns = (
            Column("views", "views"),
            Column("dB", "psnr", "{:.1f}"),
            Column("worst", "psnr_worst", "{:.1f}"),
            Column("brightest tenth", "psnr_highlights", "{:.1f}"),
        )
        found.append(table("Other programs against ours, under one lamp", views, columns))
    if files:
        columns = (
            Column("Khronos' validator", issues),
            Column("s", "seconds", "{:.1f}"),
            Column("MB", "megabytes", "{:.1f}"),
            Column("colour unobserved %", share("color_unobserved"), "{:.1f}"),
            Column("gloss unobserved %", share("gloss_unobserved"), "{:.1f}"),
            Column("cut at 1 %", share("color_cut_at_1"), "{:.1f}"),
        )
        found.append(table("The files", files, columns))
    return found


def picture(rows: Sequence[Row], path: Path) -> None:
    """The sample's first view as each program shows it, ours first, side by side."""
    shown = [row for row in rows if row["scene"] == "totem" and "picture_theirs" in row]
    if shown:
        lit = next((row for row in shown if row["name"] != THREE), shown[0])
        images = [read_image(Path(lit["picture_ours"]))]
        images += [read_image(Path(row["picture_theirs"])) for row in shown]
        write_png(path, np.hstack(images))
