"""The benchmark's command: its tables, its ledger, and what it declares."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import pytest
from totems import TEXELS, WALK, film, run

from benchmarks import ablation, documents, photographs, timing
from benchmarks.__main__ import judge_result
from benchmarks.cases import VARIABLE, Case, available, why_not
from benchmarks.documents import PAGE, PARTS, README, presets_table
from benchmarks.ledger import Ledger, Task
from benchmarks.scenes.catalogue import SCENES
from benchmarks.solve import Setup
from benchmarks.summary import sentences
from benchmarks.tables import Column, splice, table
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import check_script

CHANGES = [(e, c) for e, changes in ablation.CHANGES.items() for c in changes]


@pytest.mark.parametrize(("estimator", "change"), CHANGES, ids=lambda x: getattr(x, "settings", x))
def test_every_option_of_the_ablation_exists_and_differs(estimator, change):
    changed = chain(estimator, settings=change.parameters)
    check_script(changed)
    plain = {step.name: step.parameters for step in chain(estimator)}
    assert any(step.parameters != plain[step.name] for step in changed)
    assert set(change.scenes) <= set(SCENES)


@pytest.mark.parametrize("texture", [512, 64])
def test_every_run_of_the_time_part_is_accepted(texture):
    setups = timing.setups(texture)
    for _, setup, _ in setups.values():
        check_script(chain(setup.estimator, setup.preset, setup.settings))
    assert len({repr(entry) for entry in setups.values()}) == len(setups)


# Ledger


def task(make, name="row"):
    return Task("part", "scene", name, "about", make)


def quiet(line):
    """Says nothing."""


def test_what_is_there_is_not_measured_again_until_the_code_changes(tmp_path):
    made = []

    def make(folder):
        made.append(folder)
        return {"figure": len(made), "worst": -np.inf, "number": np.float32(1)}

    first = Ledger(tmp_path, say=quiet).rows([task(make)])
    assert Ledger(tmp_path, say=quiet).rows([task(make)]) == first
    assert first[0]["worst"] == "-inf"
    assert first[0]["number"] == 1

    later = Ledger(tmp_path, say=quiet)
    later.code = "other"
    assert later.rows([task(make)])[0]["figure"] == 2
    kept = Ledger(tmp_path, "keep", say=quiet)
    assert kept.rows([task(make)])[0]["figure"] == 2
    assert Ledger(tmp_path, "force", say=quiet).rows([task(make)])[0]["figure"] == 3
    other = Task("part", "scene", "row", "another configuration", make)
    assert kept.rows([other])[0]["figure"] == 4


def test_a_failure_is_a_row_and_is_tried_again(tmp_path, capsys):
    def fail(folder):
        folder.mkdir(parents=True)
        raise ValueError("no light\nat all")

    said = []
    ledger = Ledger(tmp_path, say=said.append)
    rows = ledger.rows([task(fail), task(lambda folder: {"figure": 1}, "second")])
    assert rows[0]["error"] == "ValueError: no light"
    assert rows[1]["figure"] == 1
    assert "no light" in said[1]
    assert "no light" in capsys.readouterr().err
    assert Ledger(tmp_path, say=quiet).rows([task(lambda folder: {"figure": 2})])[0]["figure"] == 2
    assert not list(ledger.work.rglob("*row*"))
    ledger.finish()
    assert not ledger.work.exists()


# Tables


def test_tables_write_what_is_missing_infinite_or_failed():
    columns = (Column("a", "a", "{:+.1f}"), Column("b", lambda row: row["b"], "{}"))
    rows = [
        {"scene": "s", "name": "x", "a": "-inf", "b": 0},
        {"scene": "s", "name": "y", "b": None},
        {"scene": "s", "name": "z", "error": "broken | glass"},
    ]
    made = table("Title", rows, columns, "note")
    assert made.cells == [
        ["s", "x", "-∞", "0"], ["s", "y", "–", "–"], ["s", "z", "failed: broken | glass", ""],
    ]  # fmt: skip
    lines = made.markdown().splitlines()
    assert lines[2] == "| scene | result | a | b |"
    assert all(line.count("|") == 5 for line in lines[2:-2])
    assert lines[-1] == "note"


def test_a_part_of_a_page_is_replaced_and_no_other(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- benchmark: x -->\nold\n<!-- end -->\nb <!-- end -->\n")
    splice(page, "x", "new \\1")
    assert page.read_text() == ("a\n<!-- benchmark: x -->\nnew \\1\n<!-- end -->\nb <!-- end -->\n")
    with pytest.raises(SystemExit, match="y"):
        splice(page, "y", "")


def test_the_documentation_has_a_place_for_every_part():
    text = PAGE.read_text(encoding="utf-8")
    for part in PARTS:
        assert f"<!-- benchmark: {part.PART} -->" in text
    assert presets_table() in text, "run python -m benchmarks --docs"
    assert f"<!-- benchmark: {timing.PART} -->" in README.read_text(encoding="utf-8")


def test_tables_and_plot_go_into_the_documentation(monkeypatch, tmp_path):
    try:
        version("matplotlib")  # importing tells nothing: colour-science puts a dummy in its place
    except PackageNotFoundError:
        pytest.skip("the plot needs the extra [docs]")
    for name in ("PAGE", "README"):
        copy = tmp_path / name
        copy.write_bytes(getattr(documents, name).read_bytes())
        monkeypatch.setattr(documents, name, copy)
    monkeypatch.setattr(documents, "PICTURE", tmp_path / "plot.png")
    base = {"scene": "s", "seconds": 1.0, "dE_mean": 0.5, "psnr_highlights": 40.0}
    looks = [{"seconds": s, "dE_mean": 1 / s, "psnr_highlights": s} for s in (60.0, 120.0)]
    rows = {
        "time": [
            base | {"name": "draft", "group": timing.PRESET},
            base | {"name": "slow", "group": timing.PEER, "over_time": looks},
            base | {"name": "broken", "error": "why"},
        ],
        "ablation": [
            base | {"name": f"joint: {ablation.BASE}", "change": ""},
            base | {"name": "joint: other", "change": "compute_svbrdf_a.b=1",
                    "psnr_highlights": 39.0},
        ],
        "accuracy": [base | {"name": "joint", "lights_missed": 0, "lights_false": 0,
                             "light_deg": 0.1}],
        "photographs": [base | {"name": photographs.PLAIN, "frames": 2, "share": 0.9,
                                "psnr": {"mean": [17.0, 18.0], "full": [18.0, 19.0]}}],
    }  # fmt: skip
    documents.write_documents(rows)
    page, readme = documents.PAGE.read_text(), documents.README.read_text()
    assert "| broken | failed: why |" in page
    assert "| slow 120 s † |" in page
    assert "| other (a.b=1) |" in page
    assert "| -1.0 |" in page
    assert "all found and no other on 1 of 1 scenes" in page
    assert "| diffuse and specular | 18.50 | 18.00 | +1.00 |" in page
    assert "| slow 60 s |" in readme
    assert "broken" not in readme
    assert documents.PICTURE.stat().st_size > 10_000


def test_the_front_holds_what_no_faster_run_equals():
    rows = [
        {"name": name, "seconds": s, "e": e}
        for name, s, e in [("a", 1, 5), ("b", 2, 5), ("c", 3, 4), ("d", 4, 4.5), ("e", 5, None)]
    ]
    assert timing.front(rows, "e", 1) == ["a", "c"]
    assert timing.front(rows, "e", -1) == ["a"]
    loss = [{"name": "standard", "psnr_highlights": 40.0, "seconds": 1},
            {"name": timing.EIGHTH, "psnr_highlights": 39.5, "seconds": 1}]  # fmt: skip
    assert "-0.5 dB" in timing.eighth(loss)
    assert timing.eighth(loss[:1]) == ""


# Scenes


def test_scenes_that_are_not_there_are_left_out_with_a_reason(monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    cases, notes = available(["knot", "bust_floods"], tmp_path)
    assert [case.name for case in cases] == ["knot"]
    assert notes == [f"bust_floods: left out, {VARIABLE} names no folder"]
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert "is not there" in why_not("mine")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "mine.mlp").write_text("")
    assert why_not("mine") == ""
    assert Case("mine", tmp_path).truth == tmp_path / "mine" / "ground_truth"


def test_frames_held_out_are_predicted(tmp_path_factory, tmp_path, capsys):
    """A film under a fixed exposure: highlights help, and every method is judged alike."""
    document = Document.open(film(tmp_path_factory, WALK), tmp_path)
    with pytest.raises(SvbrdfError, match="--hold-out"):
        photographs.predict(document)
    document.hold_out()
    run(document, **{TEXELS: {"texture_size": 64}})
    document.save()
    row = photographs.predict(document)
    assert row["frames"] == 8
    assert row["share"] > 0.9
    assert set(row["psnr"]) == set(photographs.NAMES)
    mean = {name: np.mean(values) for name, values in row["psnr"].items()}
    assert mean["full"] > mean["final"] + 1
    assert mean["full"] > mean["mean"] + 1
    judge_result(document.path)
    printed = capsys.readouterr().out
    assert "8 held-out frames" in printed
    assert f"{mean['full']:.2f}" in printed


def test_a_setup_takes_what_is_set_before_its_own(tmp_path):
    (tmp_path / "s").mkdir()
    case = Case("s", tmp_path)
    setup = Setup(texture=64, settings={"compute_svbrdf_texels.texture_size": "32"})
    assert setup.steps(case)[0].parameters == {"texture_size": "32"}


def test_rows_are_plain_json(tmp_path):
    Ledger(tmp_path, say=quiet).rows([task(lambda folder: {"list": [np.int64(1), np.nan]})])
    row = json.loads((tmp_path / "part" / "scene.row.json").read_text())
    assert row["list"] == [1, "nan"]


def test_a_peer_that_was_looked_at_several_times_has_a_row_for_each():
    looks = [{"seconds": s, "dE_mean": e} for s, e in ((60.2, 5), (120.4, 4))]
    rows = timing.over_time([{"name": "slow", "over_time": looks}, {"name": "fast", "seconds": 1}])
    assert [(row["name"], row["seconds"]) for row in rows] == [
        ("slow 60 s", 60.2), ("slow 120 s", 120.4), ("fast", 1),
    ]  # fmt: skip
    assert [row.get("dE_mean") for row in rows] == [5, 4, None]


def test_the_summary_counts_and_names_the_worst():
    def row(scene, name, **figures):
        return {"scene": scene, "name": name, **figures}

    def ours(scene, missed, angle, highlights, error):
        return row(
            scene, "joint", lights_missed=missed, lights_false=0, light_deg=angle,
            psnr_highlights=highlights, dE_mean=error,
        )  # fmt: skip

    rows = [
        ours("a", 0, 0.1, 45.0, 0.5), ours("b", 1, 0.3, 40.0, 1.0), ours("c", 0, None, 41.0, None),
        row("a", "paper", lights_missed=0, psnr_highlights=35.0, dE_mean=0.9),
        row("b", "paper", lights_missed=0, psnr_highlights=39.0, dE_mean=0.9),
        row("a", "mean", psnr_highlights=20.0, dE_mean=2.0),
        row("b", "mean", psnr_highlights=20.0, dE_mean=0.8),
        row("a", "truth", psnr_highlights=46.0),
        row("b", "truth", skipped="no lobe"),
        row(
            "a", "joint, true materials", lights_missed=0,
            ln_rho_s_worst=-0.04, ln_alpha_worst="inf",
        ),
        row("c", "mean", error="broken"),
    ]  # fmt: skip
    assert sentences(rows) == [
        "Lights: all found and no other on 2 of 3 scenes (not on b); "
        "0.20° in the middle, at worst 0.30° (b).",
        "|ln ρs| of the worst material, given the materials: 0.040 in the middle, "
        "at worst 0.040 (a).",
        "|ln α| of the worst material, given the materials: inf in the middle, at worst inf (a).",
        "Highlights, above `paper`: 5.5 dB in the middle, at worst 1.0 dB (b).",
        "Highlights, below the truth rendered the same way: 1.0 dB in the middle, "
        "at worst 1.0 dB (a).",
        "ΔE against `mean`: less on 1 of 2 scenes, less than half on 1; "
        "75% in the middle, at worst 125% (b) of its.",
    ]
    assert sentences([]) == []
