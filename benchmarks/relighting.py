"""Other light: how near relit views come to the truth's, and how long a picture takes.

A scene that can be judged has, beside its truth, `relight_single` (one lamp elsewhere) and
`relight_env` (an HDR map). One linear scale is fitted over all views of each.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from meshlab_svbrdf.bench.scene import MATERIALS
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters.generate_svbrdf_relighting import FILTER, illumination
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.reflectance.lights import Light
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.compare import CLIPPED, psnr
from meshlab_svbrdf.rendering.environment_lights import Illumination, cut_environment
from meshlab_svbrdf.rendering.paths import turntable
from meshlab_svbrdf.rendering.relight import RelitRenderer
from meshlab_svbrdf.rendering.surface import Appearance, SurfaceRenderer
from meshlab_svbrdf.samples.luminance import decode, encode

from .cases import Case
from .ledger import Ledger, Row, Task
from .scenes.score import albedo
from .solve import Setup, solve
from .tables import Column, Table, table

PART = "relighting"
ALBEDO = "compute_svbrdf_albedo"
SIZES = {"preview": (480, 270, 1), "full HD": (1920, 1080, 2)}  # columns, rows, supersampling
TURNS = 3  # pictures that are timed, after one that is not
_FIVE = np.ones((5, 5), np.uint8)


def tasks(
    ledger: Ledger, cases: Sequence[Case], texture: int, cache: Path | None,
    options: Options | None = None,
) -> list[Task]:  # fmt: skip
    """A row for D itself, the albedo, and the albedo that was told the lamps' size; and times."""
    found = []
    for case in cases:
        size = _lamp_radius(case)
        for name, radius in (
            ("D as it is", None), ("albedo", 0.0), (f"albedo, lamps of {size:g}° told", size),
        ):  # fmt: skip
            make = partial(_judge, ledger, case, texture, radius)
            found.append(Task(PART, case.name, name, f"{texture} texels", make))
        make = partial(_times_of_result, ledger, case, texture)
        found.append(Task(PART, case.name, "time", f"{texture} texels, {SIZES}", make))
    options = options or Options()
    make = partial(_times_of_workload, texture, cache, options)
    found.append(Task(PART, "workload", "time", f"{options}, {texture}, {SIZES}", make))
    return found


def _lamp_radius(case: Case) -> float:
    """Degrees, of the scene's lamps."""
    emitters = json.loads((case.truth / "lights.json").read_text())["emitters"]
    return round(float(np.mean([e["half_extent_deg"] for e in emitters])), 3)


def _solved(ledger: Ledger, case: Case, texture: int) -> Document:
    return solve(case, Setup(texture=texture), ledger.work / PART / case.name).document


def _judge(ledger: Ledger, case: Case, texture: int, radius: float | None, folder: Path) -> Row:
    """radius : of the lamps, 0: not told; None: D stands for the albedo."""
    document = _solved(ledger, case, texture)
    looks = read_appearance(document)
    row: Row = {}
    if radius is not None:
        said = document.apply(ALBEDO, lamp_radius=radius)
        row |= {"seconds": said.seconds} if not said.skipped else {}
        looks = [
            replace(look, diffuse=own, sheen=None, harmonics=None)
            for look, own in zip(looks, document.map("albedo"), strict=True)
        ]
    kind = "albedo" if radius is not None else "diffuse"
    row |= albedo(document.folder / "maps" / f"{kind}.exr", case.truth)
    for name, given in (
        ("relight_single", {"lights": case.truth / "relight_single" / "lights.json"}),
        ("relight_env", {"environment": case.truth / "relight_env" / "env.exr"}),
    ):
        light = illumination(document, FILTER.check(given))
        renderer = RelitRenderer(document.mesh(), looks, light, lamp_radius=radius or 0.0)
        row[name] = _views(renderer, case.truth / name)
    return row


def _views(renderer: SurfaceRenderer, truth: Path) -> float:
    """The mean PSNR of the views of `truth`, sRGB, one linear scale fitted over all of them."""
    pairs = []
    for raster in read_project(truth / "project.mlp").rasters:
        codes = read_image(raster.path)[..., :3].astype(float)
        on = (np.abs(codes - codes[0, 0]).max(-1) > 2).astype(np.uint8)
        inside = cv2.erode(cv2.morphologyEx(on, cv2.MORPH_CLOSE, _FIVE), _FIVE) > 0
        pairs.append((renderer.render(raster.camera, 3)[0][inside], codes[inside] / 255))
    made, linear = (np.concatenate(each) for each in zip(*pairs, strict=True))
    linear = decode(linear)
    usable = (linear.max(1) < CLIPPED) & (made.max(1) < CLIPPED)
    scale = (linear * made)[usable].sum() / (made**2)[usable].sum()
    return float(np.mean([psnr(encode(np.clip(scale * r, 0, 1)), t) for r, t in pairs]))


def _times_of_result(ledger: Ledger, case: Case, texture: int, folder: Path) -> Row:
    document = _solved(ledger, case, texture)
    document.apply(ALBEDO)
    looks = read_appearance(document)
    white = [
        replace(look, diffuse=own, sheen=None, harmonics=None)
        for look, own in zip(looks, document.map("albedo"), strict=True)
    ]
    sky = illumination(document, FILTER.check({"recovered": True}))
    mesh = document.mesh()
    return {
        "faces": len(mesh.faces),
        "times": _times(mesh, looks, read_lights(document), white, sky),
    }


def _times_of_workload(texture: int, cache: Path | None, options: Options, folder: Path) -> Row:
    """With the workload's truth as the result, D for the albedo, and a sky."""
    workload = make_workload(cache, 0, options)
    mesh, texels = workload.scene.mesh, workload.texels(texture)
    D, kind = workload.scene.truth(texels)
    rho_s, alpha = (
        np.array(column, float)[kind] for column in list(zip(*MATERIALS, strict=True))[1:]
    )
    (diffuse,), (strength,), (shape,) = map(texels.to_images, (D, rho_s, alpha))
    looks = [Appearance(diffuse, strength, shape, np.ones_like(diffuse))]
    lights = []
    for *place, gain in workload.scene.lamps:
        away = np.array(place) - mesh.center
        distance = float(np.linalg.norm(away))
        lights.append(
            Light(away / distance, np.eye(2) * 1e-3, gain / distance**2, mesh.radius / distance)
        )
    sky = cut_environment(np.maximum(directions(64)[..., 1:2], 0) * [0.4, 0.5, 0.8])
    return {
        "faces": len(mesh.faces),
        "times": _times(mesh, looks, lights, looks, sky),
    }


def _times(
    mesh: Mesh, looks: list[Appearance], lights: list[Light], white: list[Appearance],
    sky: Illumination,
) -> list[dict[str, Any]]:  # fmt: skip
    """Seconds of setting up, and of a picture, by light and size."""
    R = np.diag([1.0, -1.0, -1.0])
    found = []
    for light, make in (
        ("the lamps found", lambda: AcquisitionRenderer(mesh, looks, lights)),
        (f"{len(sky)} far lights", lambda: RelitRenderer(mesh, white, sky)),
    ):
        begun = time.perf_counter()
        renderer = make()
        setting_up = time.perf_counter() - begun
        for size, (columns, rows, rays) in SIZES.items():
            lens = Camera(columns, rows, 2.0 * rows, 2.0 * rows, 0, 0, R, -R @ (mesh.center - R[2]))
            around = turntable(lens, mesh.center, mesh.radius, np.array([0, 1.0, 0]), TURNS + 1)
            renderer.render(around[0], rays)
            begun, cpu = time.perf_counter(), time.process_time()
            for camera in around[1:]:
                renderer.render(camera, rays)
            seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
            found.append(
                {
                    "light": light, "size": size, "setting_up": setting_up,
                    "seconds": seconds / TURNS, "cpu_seconds": cpu / TURNS,
                }
            )  # fmt: skip
    return found


def tables(rows: Sequence[Row]) -> list[Table]:
    """What docs/albedo.md shows, then what docs/rendering.md does."""
    judged = [row for row in rows if row["name"] != "time"]
    timed = [row for row in rows if row["name"] == "time" and "error" not in row]
    columns = (
        Column("one lamp, dB", "relight_single", "{:.1f}"),
        Column("HDR map, dB", "relight_env", "{:.1f}"),
        Column("ΔE mean", "dE_mean", "{:.2f}"),
        Column("median", "dE_median", "{:.2f}"),
        Column("of the texels", "coverage", "{:.1%}"),
    )
    note = "One scale is fitted over all views of a column, and over all texels."
    made = [table("Relit views against the truth's", judged, columns, note)] if judged else []
    return made + ([_time_table(timed)] if timed else [])


def _time_table(rows: Sequence[Row]) -> Table:
    cells = [
        [
            f"{row['scene']}, {row['faces']:,} triangles", each["light"],
            f"{each['size']}, {SIZES[each['size']][0]}×{SIZES[each['size']][1]}",
            f"{1000 * each['setting_up']:.0f}", f"{1000 * each['seconds']:.0f}",
            f"{1000 * each['cpu_seconds']:.0f}",
        ]
        for row in rows for each in row["times"]
    ]  # fmt: skip
    headings = ["object", "light", "picture", "once, ms", "ms a picture", "CPU ms"]
    rays = ", ".join(f"{name} {s * s}" for name, (_, _, s) in SIZES.items())
    return Table("Time of a picture", headings, cells, (f"Rays per pixel: {rays}.",))
