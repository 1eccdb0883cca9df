"""Comparison, report, paths and the recovered light, on small films."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import parsed
from totems import VIDEO, contents, copied, edited

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, write_png
from meshlab_svbrdf.document.project import Project, read_project
from meshlab_svbrdf.document.video_file import frame_times
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters._comparison import chosen_frames, compare_frames
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters._report_pictures import comparison
from meshlab_svbrdf.filters.generate_svbrdf_relighting import FILTER, illumination
from meshlab_svbrdf.rendering.colors import inferno
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

RENDER, RELIGHT, ALBEDO = (
    "generate_svbrdf_rendering", "generate_svbrdf_relighting", "compute_svbrdf_albedo",
)  # fmt: skip
COMPARE, REPORT = "generate_svbrdf_comparison", "generate_svbrdf_report"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, VIDEO, tmp_path / "result")


def table(folder: Path) -> dict:
    return json.loads((folder / "comparison.json").read_text())


# Compare


def test_a_rendering_compared_with_itself_has_no_error(result, tmp_path):
    """The frames are replaced by what the result makes of them."""
    result.apply(RENDER, folder=tmp_path / "own", supersampling=1, background=7)
    frames = [
        replace(raster, path=tmp_path / "own" / raster.path.with_suffix(".png").name)
        for raster in result.project.rasters[::45]
    ]
    found = list(compare_frames(result, frames, supersampling=1, grey=7))
    assert [each.label for each in found] == [raster.label for raster in frames]
    for each in found:
        assert each.psnr == np.inf
        assert each.ssim == 1
        assert each.row()["psnr"] == "inf"
        clusters, diffuse, specular, rendered, frame, error = (p.image for p in each.panels)
        np.testing.assert_array_equal(rendered, frame)
        assert (error == inferno(np.zeros(1))).all()
        assert (clusters != diffuse).any()
        assert specular.max() > 240  # normalised


def test_frames_are_shown_beside_what_the_result_makes_of_them(result, tmp_path):
    before = contents(result.folder)
    said = result.apply(COMPARE, folder=tmp_path / "new" / "out", supersampling=1)
    assert "evenly spaced frames that the result was made from" in said.message
    assert contents(result.folder) == before
    told = table(tmp_path / "new" / "out")
    assert len(told["frames"]) == 4
    assert not any(row["held_out"] for row in told["frames"])
    assert min(row["psnr"] for row in told["frames"]) > 27
    names = {path.name for path in (tmp_path / "new" / "out").iterdir()}
    pictures = {Path(row["label"]).with_suffix(".png").name for row in told["frames"]}
    assert names == {*pictures, "comparison.png", "comparison.json", "comparison.csv"}
    with open(tmp_path / "new" / "out" / "comparison.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["label"] for row in rows] == [row["label"] for row in told["frames"]]
    assert [float(row["psnr"]) for row in rows] == [row["psnr"] for row in told["frames"]]
    for name in pictures:
        assert read_image(tmp_path / "new" / "out" / name).shape[1] > 6 * 60


def test_held_out_frames_are_what_is_compared_where_there_are_any(result):
    result.hold_out()
    some, how = chosen_frames(result, "", 3)
    assert how == f"held out: 3 of {len(result.held_out)}, which no stage has seen"
    held = [raster.label for raster in result.held_out]
    at = [held.index(raster.label) for raster in some]
    assert len(set(np.diff(at))) <= 2  # evenly spaced
    every, _ = chosen_frames(result, "", 100)
    assert [raster.label for raster in every] == held
    asked, how = chosen_frames(result, f"{held[2]}; {held[0]}", 1)
    assert [raster.label for raster in asked] == [held[2], held[0]]
    assert how == "as asked for"


def test_a_gain_is_fitted_where_it_is_asked_for(result, tmp_path):
    raster = result.project.rasters[0]
    frame = decode(read_image(raster.path)[..., :3] / 255)
    write_png(tmp_path / "dark.png", to_srgb8(0.6 * frame))
    dark = [replace(raster, path=tmp_path / "dark.png")]
    (plain,) = compare_frames(result, dark, supersampling=1, grey=0)
    (fitted,) = compare_frames(result, dark, supersampling=1, grey=0, gain="fit")
    assert plain.gain.tolist() == [1, 1, 1]
    np.testing.assert_allclose(fitted.gain, 0.6, atol=0.03)
    assert fitted.psnr > plain.psnr + 5


def test_what_cannot_be_compared_is_said(result, tmp_path):
    with pytest.raises(SvbrdfError, match="folder is empty"):
        result.apply(COMPARE)
    label = result.project.rasters[0].label
    with pytest.raises(SvbrdfError, match=f"no raster '{label}x', did you mean '{label}'"):
        result.apply(COMPARE, frames=f"{label}x", folder=tmp_path / "x")
    with pytest.raises(SvbrdfError, match=r"there are \d+, as in MeshLab's list: .*, …"):
        result.apply(COMPARE, frames="nosuch", folder=tmp_path / "x")
    assert not (tmp_path / "x").exists()


# Report


def test_a_report_is_one_page_that_asks_for_nothing(result, tmp_path):
    result.apply(ALBEDO)
    before = contents(result.folder)
    said = result.apply(REPORT, file=tmp_path / "deep" / "report.html")
    assert contents(result.folder) == before
    assert re.search(r"report\.html, 0\.\d MB", said.message)
    text = (tmp_path / "deep" / "report.html").read_text()
    assert "://" not in text
    found = parsed(text)
    images = [given for name, given in found if name == "img"]
    assert len(images) > 20
    assert all(given["src"].startswith("data:image/jpeg;base64,") for given in images)
    assert not {name for name, _ in found} & {"script", "link", "iframe", "object", "a"}
    assert text.count(">1 = white</text>") == text.count(">exponent</text>") == 1  # ρs, α
    plain = re.sub(r"<style>.*?</style>|<[^>]+>", " ", text, flags=re.DOTALL)
    for material in result.json("materials")["materials"]:
        if material["observed"]:
            assert f"{material['alpha']:.2f}" in plain
    for name, run in result.results.record["runs"].items():
        assert name in plain
        assert f"{run['seconds']:.1f}" in plain
    assert "No frame is held out" in plain
    assert "Not made" not in plain  # the paper's chain and the albedo: all stages are there


def test_what_others_named_is_text_in_a_report(result, tmp_path):
    """Hostile names of the project, of frames, of a material, and a reason."""
    hostile = '<img src=x onerror="alert(1)">&\'</title><script>'
    result.apply("set_svbrdf_material_names", names=f"0 {hostile.replace(';', '')}")
    path = result.folder / "frames.json"
    told = json.loads(path.read_text())
    for raster, frame in zip(result.project.rasters, told["frames"], strict=True):
        raster.label = frame["label"] = f"{raster.label} {hostile}"
    told["frames"].append({"label": "x", "left_out": hostile})
    path.unlink()  # it is linked to the one that other tests read
    path.write_text(json.dumps(told))
    result.path = result.path.with_name(f"{hostile}.mlp".replace("/", ""))
    result.apply(REPORT, file=tmp_path / "r.html", title=f"of {hostile}")
    text = (tmp_path / "r.html").read_text()
    found = parsed(text)
    assert "script" not in {name for name, _ in found}
    assert not any(key.startswith("on") for _, given in found for key in given)
    assert all(given["src"].startswith("data:") for name, given in found if name == "img")
    assert text.count("&lt;img src=x onerror=") >= 8


def test_stages_that_have_not_run_are_named(small_project, tmp_path):
    document = Document.open(small_project, tmp_path / "out")
    document.apply(REPORT, file=tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text()
    parsed(text)
    assert text.count("Not made") >= 6
    assert "compute_svbrdf_diffuse_color has not run" in text
    with pytest.raises(SvbrdfError, match=r"ends with \.html"):
        document.apply(REPORT, file=tmp_path / "r.pdf")


def test_frames_that_went_away_are_said(result, tmp_path):
    for raster in result.project.rasters:
        raster.path = tmp_path / "gone" / raster.path.name
    assert re.search("Not made: raster .* cannot be read", comparison(result))


# Render


def test_a_turntable_becomes_a_film_and_pictures(result, tmp_path):
    said = result.apply(
        RENDER, path="turntable", frames=4, size=0.4, supersampling=1, rate=10,
        folder=tmp_path / "views", video=tmp_path / "films" / "turn.mp4", distance=6.0,
    )  # fmt: skip
    assert said.message == f"4 views in {tmp_path / 'views'} and {tmp_path / 'films' / 'turn.mp4'}"
    assert len(frame_times(tmp_path / "films" / "turn.mp4")) == 4
    images = [read_image(tmp_path / "views" / f"frame_{k:04d}.png") for k in range(4)]
    assert images[0].shape == (80, 60, 3)
    assert all((image != images[0]).any() for image in images[1:])
    result.apply(
        RENDER, path="turntable", frames=4, size=0.4, supersampling=1, folder=tmp_path / "again",
        distance=6.0,
    )  # fmt: skip
    assert contents(tmp_path / "again") == contents(tmp_path / "views")
    with pytest.raises(SvbrdfError, match="within the object's radius"):
        result.apply(RENDER, path="turntable", distance=0.1, folder=tmp_path / "x")


def test_a_smooth_path_passes_the_cameras(result, tmp_path):
    """Twice as many steps as between the keys: every second picture is a key's."""

    def few(project: Project) -> None:
        del project.rasters[3:]

    keys = edited(result.project.path, tmp_path / "keys", few)
    given = {"cameras": keys, "size": 0.5, "supersampling": 1}
    result.apply(RENDER, folder=tmp_path / "keys_out", **given)
    result.apply(RENDER, folder=tmp_path / "way", path="smooth", frames=5, **given)
    names = [raster.path.with_suffix(".png").name for raster in read_project(keys).rasters]
    for k, name in enumerate(names):
        a, b = (
            read_image(tmp_path / "keys_out" / name),
            read_image(tmp_path / "way" / f"frame_{2 * k:04d}.png"),
        )
        assert (a != b).mean() < 1e-3  # but for rounding at outlines


def test_the_recovered_map_shines_as_the_lamps_do(result, tmp_path):
    result.apply(ALBEDO)
    light = illumination(result, FILTER.check({"recovered": True}))
    gains = sum(lamp.gain for lamp in read_lights(result))
    ambient = np.array(result.json("lights")["ambient"] or np.zeros(3))
    np.testing.assert_allclose(light.color.sum(0), gains + 4 * ambient, rtol=1e-9)
    strongest = max(read_lights(result), key=lambda lamp: lamp.gain)
    near = light.direction @ strongest.direction > np.cos(np.radians(15))
    assert light.color[near, 0].sum() > 0.5 * strongest.gain
    said = result.apply(
        RELIGHT, recovered=True, folder=tmp_path, path="turntable", frames=2, size=0.3,
        supersampling=1,
    )  # fmt: skip
    assert "2 views" in said.message
