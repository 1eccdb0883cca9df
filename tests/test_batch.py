"""Many projects at once: names, failures that stay alone, further attempts, going on."""

import base64
import csv
import json
import sys
from urllib.parse import unquote

import cv2
import numpy as np
import pytest
from pages import parsed
from totems import VIDEO, WALK, copied, film
from typer.testing import CliRunner

from meshlab_svbrdf import batch as module
from meshlab_svbrdf.batch import run_batch
from meshlab_svbrdf.batch_list import DONE, FAILED, LEFT, Entry, Result, read_list
from meshlab_svbrdf.batch_page import look_at, summary
from meshlab_svbrdf.cli import app
from meshlab_svbrdf.errors import DocumentError, SvbrdfError

# Stands for `run`: the project tells what it does, and every attempt is counted beside it
STUB = """
import json, os, pathlib, signal, sys
project, out = sys.argv[1], sys.argv[3]
tries = pathlib.Path(project + ".tries")
tries.write_text(str(int(tries.read_text() if tries.exists() else 0) + 1))
what = pathlib.Path(project).read_text()
if what == "weak" and tries.read_text() == "1" or what == "dead":
    os.kill(os.getpid(), signal.SIGKILL)
stage = {"name": "compute_a", "message": "1 texel; " + " ".join(sys.argv[4:])}
print(json.dumps({"stages": [stage]}))
if what == "bad":
    sys.exit("Error: raster 'a': a.jpg does not exist")
if what in ("2", "130"):
    sys.exit(int(what))
"""


@pytest.fixture
def projects(tmp_path, monkeypatch):
    (tmp_path / "stub.py").write_text(STUB)
    monkeypatch.setattr(module, "RUN", (sys.executable, str(tmp_path / "stub.py")))

    def make(*what):
        for k, text in enumerate(what):
            (tmp_path / f"p{k}.mlp").write_text(text)
        return [Entry(tmp_path / f"p{k}.mlp", f"p{k}") for k in range(len(what))]

    return make


def test_a_project_that_fails_leaves_the_others_alone(tmp_path, projects):
    said = []
    found = run_batch(
        projects("", "bad", ""), tmp_path / "out", ["--preset", "draft"], say=said.append
    )
    assert [r.state for r in found] == [DONE, FAILED, DONE]
    assert [r.attempts for r in found] == [1, 1, 1]
    assert found[1].error == "raster 'a': a.jpg does not exist"
    assert found[0].outcomes == {"compute_a": "1 texel; --json --preset draft"}
    assert said == found
    table = (tmp_path / "out" / "batch.csv").read_text()
    rows = list(csv.DictReader(table.splitlines()))
    assert [row["state"] for row in rows] == [DONE, FAILED, DONE]
    assert rows[2]["compute_a"] == "1 texel; --json --preset draft"
    told = json.loads((tmp_path / "out" / "batch.json").read_text())
    assert told["options"] == ["--preset", "draft"]
    assert told["projects"][1]["error"] == found[1].error


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_a_run_that_was_killed_is_tried_again(tmp_path, projects):
    weak, dead = run_batch(projects("weak", "dead"), tmp_path / "out", [], retries=2)
    assert (weak.state, weak.attempts) == (DONE, 2)
    assert (dead.state, dead.attempts) == (FAILED, 3)
    assert "killed by signal 9" in dead.error


@pytest.mark.parametrize(("said", "told"), [
    ("a warning\nError: p.mlp: 2 meshes are missing:\n  layer 'a': a.ply\n  layer 'b': b.ply\n",
     "p.mlp: 2 meshes are missing: layer 'a': a.ply layer 'b': b.ply"),
    ("╭─ Error ───────╮\n│ No such option │\n│ --frobnicate   │\n╰────────────────╯\n",
     "No such option --frobnicate"),
    ("Traceback:\n  File x\nKeyError: 'y'\n", "KeyError: 'y'"),
    ("", ""),
])  # fmt: skip
def test_an_error_is_told_whole_in_a_line(said, told):
    assert module._one_line(said) == told


def test_an_interruption_ends_the_batch(tmp_path, projects):
    found = run_batch(projects("", "130", ""), tmp_path / "out", [])
    assert [r.state for r in found] == [DONE, LEFT]


def test_the_page_has_a_row_for_every_project_begun_or_not(tmp_path, projects):
    run_batch(projects("", "bad", "130", ""), tmp_path / "out", ["--preset", "draft"])
    page = (tmp_path / "out" / "batch.html").read_text(encoding="utf-8")
    parsed(page)
    for name, state in (("p0", "done"), ("p1", "failed"), ("p2", "interrupted"), ("p3", "not beg")):
        row = next(row for row in page.split("<tr>") if f">{name}</strong>" in row)
        assert state in row
        assert ("a.jpg does not exist" in row) == (name == "p1")


def test_what_others_wrote_is_text_in_the_page(tmp_path):
    name = "<b>&#x22;é ?"
    (tmp_path / name).mkdir()
    (tmp_path / name / f"{name}.html").touch()
    bad = Result(name, "x.mlp", FAILED, 2, 1.0, {}, "<script>", {"<i>": "<u>"}, ["<s>"])
    found = parsed(summary(tmp_path, [name], ["<p>"], [bad]))
    assert not {"b", "i", "u", "s", "script"} & {element for element, _ in found}
    links = [given["href"] for element, given in found if element == "a"]
    assert [unquote(link) for link in links] == [f"#{name}", f"{name}/{name}.html"]


def test_a_result_is_looked_at(tmp_path, tmp_path_factory):
    document = copied(tmp_path_factory, VIDEO, tmp_path / "out")
    document.save()
    figures, remarks, picture = look_at(document.path)
    count = len(document.array("texels_face"))
    assert figures["texels"] == f"{count:,}"
    materials = [m for m in document.json("materials")["materials"] if m["observed"]]
    assert materials
    for m in materials:
        assert figures[f"material {m['id']}"].endswith(f"α {m['alpha']:.3g}")
    assert "No frame is held out: nothing here was judged by frames it had not seen." in remarks
    ((_, image),) = (each for each in parsed(picture) if each[0] == "img")
    data = base64.b64decode(image["src"].partition(",")[2])
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert max(shown.shape) == 150
    assert (abs(shown.astype(int) - 245).max(2) > 20).mean() > 0.2
    assert look_at(tmp_path / "none.mlp") == ({}, [], "")


def test_options_that_run_does_not_take_end_the_batch(tmp_path, projects):
    with pytest.raises(SvbrdfError, match="does not take --nonsense"):
        run_batch(projects("2", ""), tmp_path / "out", ["--nonsense"])
    assert not (tmp_path / "p1.mlp.tries").exists()


def test_a_list_names_projects_from_its_own_folder(tmp_path):
    for place in ("a/film", "b/film"):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "x.mlp").touch()
    (tmp_path / "y.mlp").touch()
    (tmp_path / "list.txt").write_text(
        "# two of one name\na/film/x.mlp\n\nb/film/x.mlp\ny.mlp # last"
    )
    found = read_list(tmp_path / "list.txt")
    assert [entry.name for entry in found] == ["a_film_x", "b_film_x", "y"]
    assert [entry.project for entry in found][2] == tmp_path / "y.mlp"


@pytest.mark.parametrize(
    ("text", "told"),
    [("", "names no project"), ("gone.mlp", "line 1: .*gone.mlp does not exist"),
     ("x.mlp\n./x.mlp", "line 2: .* is in line 1"), ("x.mlp\nx.mlb", "same name")],
)  # fmt: skip
def test_a_list_that_is_wrong_is_told(tmp_path, text, told):
    (tmp_path / "x.mlp").touch()
    (tmp_path / "x.mlb").touch()
    (tmp_path / "list.txt").write_text(text)
    with pytest.raises(DocumentError, match=told):
        read_list(tmp_path / "list.txt")


def test_a_list_that_cannot_be_read_is_told(tmp_path):
    with pytest.raises(DocumentError, match="a project a line"):
        read_list(tmp_path / "none.txt")


def test_two_films_in_the_shell(tmp_path, tmp_path_factory):
    """The second has lost its frames: the first has its texels all the same."""
    good = film(tmp_path_factory, WALK)
    (tmp_path / "lost.mlp").write_text("<MeshLabDocument/>")
    (tmp_path / "list").write_text(f"{good}\nlost.mlp")
    (tmp_path / "texels.mlx").write_text(
        '<FilterScript><filter name="compute_svbrdf_texels"/></FilterScript>'
    )
    words = [
        "batch",
        tmp_path / "list",
        "-o",
        tmp_path / "out",
        "--script",
        tmp_path / "texels.mlx",
        "--reports",
    ]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 1, result.output
    assert "1 of 2 projects done; not: lost." in result.output.replace("\n", " ")
    assert (tmp_path / "out" / "totem" / "totem.mlp").exists()
    links = [given["href"] for element, given in parsed(
        (tmp_path / "out" / "batch.html").read_text(encoding="utf-8")
    ) if element == "a"]  # fmt: skip
    assert links == ["#lost", "totem/totem.html"]
    parsed((tmp_path / "out" / "totem" / "totem.html").read_text(encoding="utf-8"))

    # Once more, with nothing to do for it: the table has what was said then
    table = (tmp_path / "out" / "batch.csv").read_text()
    CliRunner().invoke(app, [str(word) for word in words])
    first, second = (
        [row["compute_svbrdf_texels"] for row in csv.DictReader(text.splitlines())]
        for text in (table, (tmp_path / "out" / "batch.csv").read_text())
    )
    assert "texels at" in first[0]
    assert first == second
