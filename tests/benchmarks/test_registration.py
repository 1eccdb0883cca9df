"""The registration part: what it declares, its work in small, its table."""

from __future__ import annotations

import numpy as np
from analytic import orbit, sphere
from registration_scenes import Print, draw

from benchmarks import registration
from benchmarks.cases import Case
from meshlab_svbrdf.registration.results import Options


def test_every_film_and_set_of_photographs_is_measured(tmp_path):
    film, stills = Case("film", tmp_path), Case("stills", tmp_path)
    tasks = registration.tasks([film], [stills], tmp_path)
    assert [task.name for task in tasks if task.scene == "stills"] == ["photographs"]
    assert len({(task.scene, task.name) for task in tasks}) == len(tasks)


def test_a_film_is_measured_as_images_and_as_video(tmp_path):
    mesh, cameras = (
        sphere(24),
        orbit(6, 4.5, turns=1 / 20, climb=2, width=320, height=240, fx=360.0),
    )
    frames = [draw(mesh, camera, Print(2, finest=25.0)) for camera in cameras]
    rows = []
    for name, given in (
        ("images", frames),
        ("H.264", registration._encoded(frames, tmp_path / "v.mp4")),
    ):
        row = registration._registered(
            mesh, cameras, given, Options(features=150), registration.FILM
        )
        rows.append({"scene": "ball", "name": name, **row})
    assert all(max(row["errors"]) < 1 for row in rows)
    (table,) = registration.tables(rows)
    assert [cells[2:4] for cells in table.cells] == [["6", "6"], ["6", "6"]]


def test_the_error_is_the_motion_of_what_is_seen():
    mesh, (camera,) = sphere(24), orbit(1, width=160, fx=150.0)
    assert registration._error(mesh, camera, camera) == 0
    aside = camera.cropped(0, 0, camera.width, camera.height)
    aside = aside.__class__(**{**vars(aside), "cx": camera.cx + 3.0})
    np.testing.assert_allclose(registration._error(mesh, camera, aside), 3.0)


def test_a_search_that_failed_unsaid_is_counted():
    row = {
        "scene": "bust", "name": "search", "kind": registration.SEARCH, "frames": 3,
        "errors": [0.5, 9.0, 9.0], "converged": [True, True, False], "seconds": 3.0, "cpu": 3.0,
    }  # fmt: skip
    (table,) = registration.tables([row])
    assert "1 right, 1 wrong, 1 refused" in table.cells[0]
