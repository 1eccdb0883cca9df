"""The plan: what it decides and why; the user's word stands; the disk is asked first."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from totems import SAMPLES, TEXELS, THRESHOLD, WALK, edited, film
from typer.testing import CliRunner

from meshlab_svbrdf import cli, plan
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.plan import make_plan
from meshlab_svbrdf.presets import TEXTURE_SIZE, chain
from sample_projects.procedural.recipe import MATERIALS

MATT = replace(
    WALK, frames=40, width=240, height=320, materials=(MATERIALS[0],) * 3, noise=1.0, clipped=0.0
)


@pytest.fixture
def walk(tmp_path_factory) -> Path:
    return film(tmp_path_factory, WALK)


def planned(path: Path, folder: Path, preset="standard", **given: str):
    settings = {f"compute_svbrdf_{k.replace('__', '.')}": v for k, v in given.items()}
    document = Document.open(path, folder)
    return make_plan(document, chain("joint", preset, settings), settings)


def of(plan, step: str) -> dict[str, str]:
    return next(s.parameters for s in plan.steps if s.name == step)


def decided(plan, about: str):
    return next(d for d in plan.decisions if d.about == about)


def test_it_writes_nothing(walk, tmp_path):
    before = sorted(walk.parent.rglob("*"))
    planned(walk, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert sorted(walk.parent.rglob("*")) == before


def test_small_frames_get_a_small_texture(walk, tmp_path):
    """120×160 pixels show less than 1024×1024 texels hold."""
    made = planned(walk, tmp_path)
    side = int(of(made, TEXELS)["texture_size"])
    assert side in (128, 256)
    assert f"{side}×{side}" in decided(made, "texture").choice
    assert "only cost time" in decided(made, "texture").reason


def test_what_the_user_sets_stays(walk, tmp_path):
    made = planned(walk, tmp_path, texels__texture_size="1024", samples__frames="7")
    assert of(made, TEXELS)["texture_size"] == "1024"
    assert decided(made, "texture").given
    assert "would hold all" in decided(made, "texture").reason
    assert of(made, SAMPLES)["frames"] == "7"
    assert made.frames == 7
    assert decided(made, "frames").given


@pytest.mark.parametrize(("frames", "few"), [("14", False), ("20", True), ("0", False)])
def test_few_photographs_are_content_with_few_samples(walk, tmp_path, frames, few):
    """But not where lights and gloss would go wrong: texels are seen by 4, 6 and 18 frames."""
    made = planned(walk, tmp_path, samples__frames=frames)
    assert ("minimum_samples" in of(made, THRESHOLD)) == few
    assert ("threshold" in {d.about for d in made.decisions}) == (frames != "0")
    if frames == "14":
        assert decided(made, "threshold").choice == "from 8 samples on"
        assert "seen by about 4 frames: below 6 lights" in decided(made, "threshold").reason
    if few:
        assert of(made, THRESHOLD)["minimum_samples"] == "4"
        assert decided(made, "threshold").choice == "from 4 samples on"
        mean = made.samples / made.texels
        assert f"seen by about {mean:.0f} frames" in decided(made, "threshold").reason
    own = planned(walk, tmp_path, samples__frames=frames, luminance_threshold__minimum_samples="6")
    assert of(own, THRESHOLD)["minimum_samples"] == "6"
    assert decided(own, "threshold").given


def test_it_never_asks_for_more_than_the_chain_would_do(walk, tmp_path):
    """A finer texture than the preset's is a word of advice, no choice."""
    big = edited(walk, tmp_path / "in", _finer)
    made = planned(big, tmp_path / "out")
    assert "texture_size" not in of(made, TEXELS)
    assert "--texture-size 8192" in decided(made, "texture").reason


def _finer(project) -> None:
    for raster in project.rasters:
        c = raster.camera
        raster.camera = replace(c, fx=c.fx * 40, fy=c.fy * 40)


def test_counts_are_those_of_the_run(walk, tmp_path):
    made = planned(walk, tmp_path, "full")
    document = Document.open(walk, tmp_path)
    for step in made.steps[:3]:
        document.apply(step.name, **step.parameters)
    frames = document.json("frames")["frames"]
    assert sum("samples" in frame for frame in frames) == made.frames == 60
    assert made.texels == pytest.approx(len(document.texels()), rel=0.05)
    assert made.samples == pytest.approx(sum(f["samples"] for f in frames), rel=0.05)
    written = sum(p.stat().st_size for p in document.result_folder("samples").iterdir())
    assert made.store == pytest.approx(written, rel=0.1)


def test_glossy_objects_keep_the_search_for_highlights(walk, tmp_path):
    made = planned(walk, tmp_path)
    assert decided(made, "highlights").choice == "sought"
    assert made.seconds["compute_svbrdf_material_specular"] > 1


def test_a_matt_object_is_spared_it_unless_the_user_wants_it(tmp_path_factory, tmp_path):
    path = film(tmp_path_factory, MATT)
    made = planned(path, tmp_path / "a")
    assert decided(made, "highlights").choice == "not sought", decided(made, "highlights")
    assert of(made, "compute_svbrdf_material_specular")["gloss"] == "none"
    kept = planned(path, tmp_path / "a", material_specular__gloss="seek")
    assert of(kept, "compute_svbrdf_material_specular")["gloss"] == "seek"

    # What is spared is said, and the rest is there
    document = Document.open(path, tmp_path / "b")
    told = {s.name: document.apply(s.name, **s.parameters).message for s in made.steps}
    assert "no highlights were looked for" in told["compute_svbrdf_material_specular"]
    assert not any(m["observed"] for m in document.json("materials")["materials"])
    diffuse = document.attribute("final_diffuse")
    assert np.isfinite(diffuse).all(1).mean() > 0.75


def test_frames_that_cannot_be_read_are_left_to_the_filter(walk, tmp_path):
    shutil.copytree(walk.parent, tmp_path / "in")
    for path in (tmp_path / "in").rglob("*.jpg"):
        path.write_bytes(b"")
    made = planned(tmp_path / "in" / walk.name, tmp_path / "out")
    assert made.seconds == {}
    assert decided(made, "highlights").choice == "sought"


def test_without_frames_there_is_nothing_to_plan(walk, tmp_path):
    empty = edited(walk, tmp_path / "in", lambda project: project.rasters.clear())
    with pytest.raises(DocumentError, match="has no rasters"):
        planned(empty, tmp_path / "out")


# The disk


@pytest.fixture
def disk(monkeypatch):
    def hold(free: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=free))

    return hold


def test_too_small_a_disk_is_told_before_anything_is_written(walk, tmp_path, disk):
    disk(1000)
    document = Document.open(walk, tmp_path / "a")
    document.apply(TEXELS, texture_size=64)
    with pytest.raises(SvbrdfError, match=r"need about \d.*kB on disk, and 1 kB are free.*frames"):
        document.apply(SAMPLES)
    assert not document.has("samples")
    assert not list((tmp_path / "a").rglob("*chunk*"))
    result = CliRunner().invoke(cli.app, ["run", str(walk), "-o", str(tmp_path / "b")])
    assert result.exit_code == 1
    assert "are free: use fewer frames" in result.stderr
    assert not list((tmp_path / "b").rglob("*.npy"))


def test_a_disk_that_just_suffices_is_used(walk, tmp_path, disk):
    """Though it would not, did every frame see every texel."""
    document = Document.open(walk, tmp_path)
    document.apply(TEXELS, texture_size=64)
    texels = len(document.texels())
    disk(3 * texels * 60)
    document.apply(SAMPLES)
    assert document.has("samples")


def test_too_little_memory_is_told_before_anything_is_written(walk, tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "machine_bytes", lambda: 250e6)
    words = ["run", str(walk), "-o", str(tmp_path), "--texture-size", "64"]
    result = CliRunner().invoke(cli.app, words)
    assert result.exit_code == 1
    assert "MB of memory for" in result.stderr
    assert "this machine has 250 MB" in " ".join(result.stderr.split())
    assert not list(tmp_path.rglob("*.npy"))


# The shell


def test_the_shell_tells_it(walk, tmp_path):
    result = CliRunner().invoke(cli.app, ["plan", str(walk)])
    assert result.exit_code == 0, result.output
    for word in ("texture", "frames", "visibility", "environment", "highlights", "cost"):
        assert any(line.startswith(word) for line in result.stdout.splitlines()), result.stdout
    words = ["plan", str(walk), "--preset", "draft", "--set", f"{TEXTURE_SIZE}=64", "--json"]
    told = json.loads(CliRunner().invoke(cli.app, words).stdout)
    texture = next(d for d in told["decisions"] if d["about"] == "texture")
    assert texture["given"]
    assert texture["choice"] == "64×64"
    assert told.keys() >= {"frames", "texels", "samples", "seconds", "store", "free", "memory"}
    bad = CliRunner().invoke(
        cli.app, ["plan", str(walk), "--set", "compute_svbrdf_samples.frame=1"]
    )
    assert bad.exit_code == 1
    assert "did you mean frames" in " ".join(bad.stderr.split())


def test_a_run_says_it_in_short_and_follows_it(walk, tmp_path):
    words = ["run", str(walk), "-o", str(tmp_path), "--set", "compute_svbrdf_samples.frames=30"]
    result = CliRunner().invoke(cli.app, words)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].startswith("plan: texture 256×256; frames 30 of 60; visibility yes")
    assert lines[1].startswith("plan: about ")
    assert "256×256" in lines[2]
    assert "of 30 frames, spread evenly: 30 are left out" in result.stdout


@pytest.mark.parametrize(("seconds", "words"), [(3.2, "3 s"), (600, "10.0 min"), (7200, "2.0 h")])
def test_durations_in_words(seconds, words):
    assert plan._duration(seconds) == words
