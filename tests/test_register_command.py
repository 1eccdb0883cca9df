"""`meshlab-svbrdf register`: which filter it runs, on what, and the chain after it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from meshlab_svbrdf import cli
from meshlab_svbrdf.commands_register import registration_step
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.footage import open_images
from meshlab_svbrdf.document.registered import FORMAT, FrameReport, clip_json
from meshlab_svbrdf.filter import Filter, Parameter
from meshlab_svbrdf.filters._clips import FOOTAGE, LENS
from meshlab_svbrdf.filters._registration import REPORT
from meshlab_svbrdf.filters._starts import STARTS
from meshlab_svbrdf.geometry.camera import Camera

TRACK = "generate_svbrdf_registered_rasters"


def shell(*words):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def options(**given):
    plain = dict.fromkeys(
        ["video", "images", "start", "points", "camera", "cameras", "pairs", "focal", "focal_mm",
         "sensor_width", "threshold"]
    )  # fmt: skip
    return (
        plain
        | {"align": "auto", "step": 1, "range": "", "sharpest": False, "distortion": ""}
        | given
    )


@pytest.mark.parametrize(
    ("given", "name", "parameters"),
    [
        (
            {"video": [Path("/a.mp4"), Path("/b.mp4")], "points": [Path("/p.csv")], "step": 3},
            TRACK,
            {"video": "/a.mp4; /b.mp4", "points": "/p.csv", "step": "3"},
        ),
        (
            {"images": Path("/walk"), "start": ["f 1.jpg", "f2.jpg"], "range": "10:40"},
            TRACK,
            {"images": "/walk", "start": "f 1.jpg; f2.jpg", "first": "10", "last": "40"},
        ),
        (
            {"images": Path("/w"), "cameras": Path("/sparse/0"), "align": "points"},
            "generate_svbrdf_rasters_from_cameras",
            {"images": "/w", "cameras": "/sparse/0", "align": "points"},
        ),
        ({"threshold": 0.5}, "apply_svbrdf_raster_refinement", {"threshold": "0.5"}),
        (
            {"images": Path("/w"), "range": "10:"},
            TRACK,
            {"images": "/w", "first": "10", "last": "-1"},
        ),
    ],
)  # fmt: skip
def test_the_options_choose_the_filter(given, name, parameters):
    step = registration_step(options(**given), {})
    assert step.name == name
    assert step.parameters == parameters


@pytest.fixture
def chain(demos, small_project, monkeypatch):
    """A registration that gives every image the same camera, and the demo filters as the chain."""
    camera = Camera(8, 6, 10.0, 10.0, 3.5, 2.5, *_pose())

    def register(document, parameters, progress):
        clip = open_images(parameters.images)
        frames = [
            FrameReport(name, clip.files[k], k, float("nan"), True, "registered", "", 0.1, 9, 1.0,
                        0.2, camera)
            for k, name in enumerate(clip.names)
        ]  # fmt: skip
        document.set_rasters({"format": FORMAT, "clips": [clip_json(clip, frames)]})
        return f"{len(frames)} of {len(frames)} frames registered"

    parameters = (*FOOTAGE, *STARTS, *LENS, *REPORT, Parameter("order", "string", ""))
    demos[TRACK] = Filter(
        TRACK, "Register", ("mesh",), ("registration",), parameters, apply=register
    )  # fmt: skip
    return small_project


def _pose():
    import numpy as np

    return np.eye(3), np.array([0.0, 0.2, 9.0])


def test_a_bare_mesh_becomes_a_project_with_rasters(chain, tmp_path):
    folder = chain.parent
    words = ("register", folder / "mesh.ply", "--images", folder / "frames", "-o", tmp_path / "out")
    result = shell(*words)
    assert result.exit_code == 0, result.output
    assert "9 of 9 frames registered" in result.stdout
    document = Document.open(tmp_path / "out" / "mesh.mlp")
    assert [layer.label for layer in document.layers] == ["mesh"]
    assert len(document.rasters) == 9
    assert shell(*words).stdout.splitlines()[0].endswith("unchanged")
    assert len(Document.open(tmp_path / "out" / "mesh.mlp").rasters) == 9


def test_json_has_all_stages(chain, tmp_path):
    folder = chain.parent
    result = shell(
        "register", chain, "--images", folder / "frames", "-o", tmp_path / "out", "--json"
    )  # fmt: skip
    told = json.loads(result.stdout)
    assert [stage["name"] for stage in told["stages"]] == [TRACK]
    assert told["project"] == str(tmp_path / "out" / "small.mlp")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--images", "x", "--align", "points"], "align does not go with"),
        (["--images", "x", "--pairs", "y"], "pairs does not go with"),
        (["--images", "x", "--range", "ten"], "expected FIRST:LAST"),
        (["--images", "x", "--set", "compute_demo_texels.size=4"], "add --run"),
        (["--images", "x", "--preset", "draft"], "add --run"),
        (["--images", "x", "--set", "stepp=4"], "did you mean step"),
        (["--images", "nowhere"], "is no folder"),
    ],
)
def test_what_does_not_go_together_is_said(chain, tmp_path, words, says):
    result = shell("register", chain, *words, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert says in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_the_users_project_and_other_files_are_not_replaced(chain, tmp_path):
    folder = chain.parent
    result = shell("register", chain, "--images", folder / "frames", "-o", folder)
    assert result.exit_code == 1
    assert "would replace" in result.stderr
    (tmp_path / "x.stl").write_text("solid")
    result = shell(
        "register", tmp_path / "x.stl", "--images", folder / "frames", "-o", tmp_path / "o"
    )
    assert result.exit_code == 1
    assert "expected a MeshLab project" in result.stderr
