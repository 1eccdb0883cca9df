"""The export part: cameras as OpenGL has them, how pictures are judged, its tables."""

from __future__ import annotations

import numpy as np
import pytest
from analytic import look_at

from benchmarks import export
from benchmarks.exports import blender, three
from benchmarks.ledger import Ledger
from meshlab_svbrdf.document.images import read_image, write_png


def test_a_page_projects_points_where_our_camera_does():
    camera = look_at([2.0, 1.0, 3.0], width=64, height=48, fx=70.0, fy=66.0, cx=29.0, cy=27.5)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    world, projection = (np.reshape(m, (4, 4)).T for m in three._matrices(camera))
    clip = np.column_stack([points, np.ones(20)]) @ (projection @ np.linalg.inv(world)).T
    x, y, depth = (clip[:, :3] / clip[:, 3:]).T
    col, row, _ = camera.project(points).T
    np.testing.assert_allclose((x + 1) / 2 * 64 - 0.5, col, atol=1e-9)
    np.testing.assert_allclose((1 - y) / 2 * 48 - 0.5, row, atol=1e-9)
    assert (np.abs(depth) < 1).all()


def test_small_pixels_are_averaged_in_linear_light():
    codes = np.zeros((2, 4, 3), np.uint8)
    codes[:, ::2] = 255
    np.testing.assert_allclose(three._mean(codes, 2), 0.5)


def picture(level: int) -> np.ndarray:
    image = np.full((40, 40, 3), export.GREY, np.uint8)
    image[8:32, 8:32] = level
    image[12:16, 12:16] = 250
    return image


def test_what_is_around_the_object_does_not_count():
    ours, theirs = picture(60), picture(60)
    theirs[:4] = 0  # beside it
    row = export._judged([theirs], [ours])
    assert row["psnr"] > 100
    theirs[8:32, 8:32] = ours[8:32, 8:32] + 2
    row = export._judged([theirs, ours], [ours, ours])
    assert row["psnr_worst"] == pytest.approx(10 * np.log10(255**2 / 4), abs=1e-6)


def test_tables_and_picture_are_of_what_was_measured(tmp_path):
    rows = []
    for name, level in ((export.THREE, 90), (export.MITSUBA, 61)):
        row = export._judged([picture(level)], [picture(60)])
        for who, image in zip(("theirs", "ours"), row.pop("pictures"), strict=True):
            path = tmp_path / f"{name[:3]}.{who}.png"
            write_png(path, image)
            row[f"picture_{who}"] = str(path)
        rows.append({"scene": "totem", "name": name, **row})
    files = {
        "scene": "totem", "name": export.FILES, "seconds": 1.0, "megabytes": 2.0,
        "validator": {"errors": 0, "warnings": 0, "remarks": 1},
        "coverage": {"color_unobserved": 0.1, "gloss_unobserved": 0.2, "color_cut_at_1": 0.0},
    }  # fmt: skip
    alike, told = export.tables([*rows, files])
    assert [cells[1] for cells in alike.cells] == [export.THREE, export.MITSUBA]
    assert told.cells[0][2] == "0 errors, 0 warnings, 1 remarks"
    export.picture(rows, tmp_path / "all.png")
    shown = read_image(tmp_path / "all.png")
    assert shown.shape == (40, 120, 3)
    assert [shown[20, 20 + 40 * k, 0] for k in range(3)] == [60, 90, 61]


def test_programs_that_are_not_there_are_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(blender, "why_not", lambda: "has no bpy")
    ledger = Ledger(tmp_path / "out", say=lambda line: None)
    found, missing = export.tasks(ledger, [export.Sample("totem", tmp_path)], 64, tmp_path)
    assert {task.name for task in found} <= {export.MITSUBA}
    assert any(line.startswith(export.THREE) and "node" in line for line in missing)
    assert f"{export.BLENDER}: left out, has no bpy" in missing
