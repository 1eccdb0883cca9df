"""`meshlab-svbrdf render | compare | report`: which filters they run, with which parameters."""

import pytest
from typer.testing import CliRunner

from meshlab_svbrdf import cli, registry
from meshlab_svbrdf.commands_show import ALBEDO, COMPARISON, RELIGHTING, RENDERING, REPORT
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filter import Filter


def shell(*words):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


@pytest.fixture
def ran(demos, small_project) -> list:
    """What runs, on a project that counts as finished: the real parameters, nothing done."""
    got: list = []

    def stand_in(name: str, writes: tuple[str, ...] = ()) -> Filter:
        def apply(document, parameters, progress):
            got.append((name, vars(parameters)))
            return "done"

        return Filter(name, "x", parameters=PARAMETERS[name], writes=writes, apply=apply)

    for name in PARAMETERS:
        demos[name] = stand_in(name, ("albedo",) if name == ALBEDO else ())
    return got


PARAMETERS = {
    name: registry.filters()[name].parameters
    for name in (RENDERING, RELIGHTING, ALBEDO, COMPARISON, REPORT)
}


def finished(project) -> None:
    with Document.open(project).write("material_specular"):
        pass


def test_results_come_first(ran, small_project, tmp_path):
    before = sorted(small_project.parent.rglob("*"))
    for command, out in (("render", "out"), ("compare", "out"), ("report", "r.html")):
        result = shell(command, small_project, "-o", tmp_path / out)
        assert result.exit_code == 1
        assert f"no results to {command}" in result.stderr
    assert not ran
    assert sorted(small_project.parent.rglob("*")) == before
    with Document.open(small_project).write("texels"):
        pass
    assert shell("report", small_project, "-o", tmp_path / "r.html").exit_code == 0
    assert ran[0][0] == REPORT  # which later stages are missing is said there
    assert ran[0][1]["file"] == tmp_path / "r.html"


def test_rendering_takes_cameras_a_path_and_a_preview(ran, small_project, tmp_path):
    finished(small_project)
    words = ("render", small_project, "-o", tmp_path / "views")
    assert shell(*words, "--cameras", small_project).exit_code == 0
    name, given = ran.pop()
    assert name == RENDERING
    assert (given["cameras"], given["folder"]) == (small_project, tmp_path / "views")
    assert (given["path"], given["size"], given["video"]) == ("cameras", 1, None)
    film = tmp_path / "a.mp4"
    result = shell(
        "render", small_project, "-o", film, "--path", "turntable", "--frames", 9,
        "--elevation", 30, "--distance", "20%", "--lamp-radius", 2, "--preview",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    name, given = ran.pop()
    assert (given["video"], given["folder"]) == (film, None)
    assert (given["path"], given["frames"], given["elevation"]) == ("turntable", 9, 30)
    assert given["distance"] > 0
    camera = Document.open(small_project).project.rasters[0].camera
    size = min(max(0.25, 320 / max(camera.width, camera.height)), 1)
    assert (given["size"], given["supersampling"], given["lamp_radius"]) == (size, 1, 2)


@pytest.mark.parametrize(
    ("out", "words", "said"),
    [
        ("a.avi", (), "films are .mp4"),
        ("a.GIF", (), "films are .mp4"),
        ("views", ("--frames", 5), "--frames is of a path: give --path"),
        ("views", ("--elevation", 5), "--elevation is of a turntable"),
        ("a.mp4", ("--path", "smooth", "--distance", 5), "--distance is of a turntable"),
        ("views", ("--exposure", 1), "--environment, --lights or --recovered"),
    ],
)
def test_what_would_be_ignored_is_refused(ran, small_project, tmp_path, out, words, said):
    finished(small_project)
    result = shell("render", small_project, "-o", tmp_path / out, *words)
    assert result.exit_code == 1
    assert said in result.stderr
    assert not ran
    assert not (tmp_path / out).exists()


def test_other_light_makes_the_albedo_first_unless_it_is_there(ran, small_project, tmp_path):
    finished(small_project)
    words = ("render", small_project, "-o", tmp_path / "views", "--recovered")
    assert shell(*words, "--exposure", 1, "--lamp-radius", 2).exit_code == 0
    (first, own), (second, given) = ran
    assert (first, second) == (ALBEDO, RELIGHTING)
    assert own["lamp_radius"] == given["lamp_radius"] == 2
    assert (given["recovered"], given["exposure"]) == (True, 1)
    ran.clear()
    assert shell(*words).exit_code == 0
    assert [name for name, _ in ran] == [RELIGHTING]
    result = shell("render", small_project, "-o", tmp_path / "views", "--turn", 20)
    assert result.exit_code == 1
    assert "of other light" in result.stderr


def test_comparing_names_frames(ran, small_project, tmp_path):
    finished(small_project)
    assert shell("compare", small_project, "-o", tmp_path / "c").exit_code == 0
    assert ran.pop()[1]["frames"] == ""
    words = ("--frames", "f1.png", "--frames", "f2.png")
    result = shell("compare", small_project, "-o", tmp_path / "c", *words)
    assert result.exit_code == 0, result.output
    name, given = ran.pop()
    assert (name, given["frames"]) == (COMPARISON, "f1.png; f2.png")
    assert given["folder"] == tmp_path / "c"
