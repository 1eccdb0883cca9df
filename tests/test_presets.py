"""Presets: what they set exists, explicit options win, and the shell says them."""

import json

import numpy as np
import pytest
from totems import SAMPLES, TEXELS, WALK, film
from typer.testing import CliRunner

from meshlab_svbrdf import MeshSet, cli
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.presets import CHAINS, PRESETS, chain
from meshlab_svbrdf.script import check_script

SIZE = f"{TEXELS}.texture_size"


def parameters(steps, name):
    return next(step.parameters for step in steps if step.name == name)


@pytest.mark.parametrize("estimator", CHAINS)
@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_is_a_chain_that_is_accepted(estimator, preset):
    check_script(chain(estimator, preset))


def test_the_shell_offers_them_all():
    assert list(cli.PresetName) == list(PRESETS)
    told = CliRunner().invoke(cli.app, ["presets", "--json"])
    assert {name: entry["parameters"] for name, entry in json.loads(told.stdout).items()} == {
        name: dict(preset.parameters) for name, preset in PRESETS.items()
    }
    assert "texture_size=512" in CliRunner().invoke(cli.app, ["presets"]).stdout


def test_full_is_the_filters_defaults():
    assert not PRESETS["full"].parameters


def test_paper_keeps_every_frame():
    assert parameters(chain("joint"), SAMPLES) == {"spacing": "3", "frames": "160"}
    assert parameters(chain("paper"), SAMPLES) == {}


def test_what_the_user_sets_wins():
    assert parameters(chain(preset="draft"), TEXELS) == {"texture_size": "512"}
    assert parameters(chain(preset="draft", settings={SIZE: 64}), TEXELS) == {"texture_size": "64"}


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"preset": "ful"}, "did you mean full"),
        ({"estimator": "joints"}, "did you mean joint"),
        ({"settings": {"compute_svbrdf_nothing.x": 1}}, "no compute_svbrdf_nothing"),
    ],
)
def test_what_there_is_not_is_said(given, told):
    with pytest.raises(SvbrdfError, match=told):
        chain(**given)


def test_the_shell_says_the_preset_and_options_win(tmp_path_factory, tmp_path):
    project = film(tmp_path_factory, WALK)
    script = tmp_path / "one.mlx"
    script.write_text('<FilterScript><filter name="compute_svbrdf_texels"/></FilterScript>')
    words = ["run", str(project), "-o", str(tmp_path), "--preset", "draft"]
    refused = CliRunner().invoke(cli.app, [*words, "--script", str(script)])
    assert refused.exit_code == 2
    told = CliRunner().invoke(cli.app, [*words, "--texture-size", "48"])
    assert told.exit_code == 0, told.output
    assert told.stdout.startswith("preset draft: compute_svbrdf_texels.texture_size=512")
    assert "48×48" in told.stdout


def test_from_python(tmp_path_factory):
    ms = MeshSet()
    ms.load_project(film(tmp_path_factory, WALK))
    told = ms.run("draft", settings={SIZE: 32})
    assert [entry["name"] for entry in told] == [step.name for step in chain()]
    assert "32×32" in told[0]["message"]


@pytest.mark.parametrize(
    ("step", "spacing", "used"),
    [(1, 0, 60), (1, 25, 30), (2, 25, 30), (1, 30, 30), (2, 5, 30), (1, 36, 20)],
)
def test_spacing_thins_films_evenly(tmp_path_factory, tmp_path, step, spacing, used):
    """The frames of the walk are 12° apart, in two orbits of 30."""
    document = Document.open(film(tmp_path_factory, WALK), tmp_path)
    document.apply(TEXELS, texture_size=32)
    outcome = document.apply(SAMPLES, step=step, spacing=spacing)
    frames = document.json("frames")["frames"]
    assert sum("samples" in frame for frame in frames) == used
    assert ("left out" in outcome.message) == (used < 60)
    if used == 20:
        kept = [k % 30 for k, frame in enumerate(sorted(frames, key=lambda f: f["label"]))
                if "samples" in frame]  # fmt: skip
        assert set(kept) <= set(range(0, 30, 3))


@pytest.mark.parametrize("limit", [1, 7, 20, 59])
def test_a_limit_spreads_frames_evenly_and_keeps_their_order(tmp_path_factory, tmp_path, limit):
    document = Document.open(film(tmp_path_factory, WALK), tmp_path)
    document.apply(TEXELS, texture_size=32)
    outcome = document.apply(SAMPLES, frames=limit)
    frames = document.json("frames")["frames"]
    used = [frame for frame in frames if "samples" in frame]
    assert len(used) == limit
    assert len(frames) == 60
    assert f"of {limit} frames, spread evenly: {60 - limit} are left out" in outcome.message
    assert all("spread evenly" in f["left_out"] for f in frames if "samples" not in f)
    labels = [frame["label"] for frame in used]
    assert labels == [r.label for r in document.rasters if r.label in labels]
    sequence, order = document.array("samples_sequence"), document.array("samples_order")
    for film_ in set(sequence.tolist()):
        assert (np.diff(order[sequence == film_]) > 0).all()


def test_a_limit_comes_after_spacing(tmp_path_factory, tmp_path):
    document = Document.open(film(tmp_path_factory, WALK), tmp_path)
    document.apply(TEXELS, texture_size=32)
    document.apply(SAMPLES, spacing=25, frames=11)
    used = [f["label"] for f in document.json("frames")["frames"] if "samples" in f]
    assert len(used) == 11
    assert all(int(label[-7:-4]) % 2 == 0 for label in used)
