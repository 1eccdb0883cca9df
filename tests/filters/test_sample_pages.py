"""compute_svbrdf_samples and _luminance_threshold: exposures, masks, frames that are not there."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic import angle, sphere
from totems import (
    LIGHTS,
    SAMPLES,
    TEXELS,
    THRESHOLD,
    WALK,
    contents,
    edited,
    film,
    run,
    sized,
    solved,
    with_mesh,
)

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.project import Project
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.filters import compute_svbrdf_samples
from meshlab_svbrdf.samples.steadiness import Steadiness

VARYING = replace(WALK, exposure=0.3, exif=True, masks=True, views=0)


@pytest.fixture
def walk(tmp_path_factory) -> Path:
    return film(tmp_path_factory, WALK)


@pytest.fixture
def plain(tmp_path_factory) -> Document:
    """The result of the film at a fixed exposure."""
    return Document.open(solved(tmp_path_factory, WALK))


def frames(document: Document) -> dict[str, dict]:
    return {frame["label"]: frame for frame in document.json("frames")["frames"]}


# What is written


def test_frames_json_tells_about_every_frame(plain):
    record = plain.json("frames")
    assert record.keys() >= {"exposure", "gains_fitted", "gain_spread", "stills", "frames"}
    assert [f["label"] for f in record["frames"]] == [r.label for r in plain.rasters]
    for frame in record["frames"]:
        assert frame.keys() >= {"label", "sequence", "gain", "samples", "quality", "residual"}
        assert frame["gain"] == [1, 1, 1]
        assert frame["samples"] > 1000
        assert 0.1 < frame["quality"] <= 1
        assert 0 <= frame["residual"] < 0.2
    assert not record["gains_fitted"]
    assert record["gain_spread"] < 0.03
    assert record["stills"]
    assert record["median_step_degrees"] == pytest.approx(11, abs=1.5)
    assert "stills, 11° apart" in plain.results.record["runs"][SAMPLES]["message"]
    total = sum(frame["samples"] for frame in record["frames"])
    assert plain.attribute("frames").sum() == total == plain.attribute("samples").sum()


def test_texels_with_fewer_than_8_samples_are_unobserved(plain):
    few = plain.attribute("frames") < 8
    assert 0.01 < few.mean() < 0.2
    np.testing.assert_array_equal(np.isnan(plain.attribute("threshold")), few)
    diffuse = plain.attribute("diffuse")
    np.testing.assert_array_equal(np.isnan(diffuse).any(1), few)
    np.testing.assert_array_equal(np.isnan(plain.attribute("final_diffuse")).any(1), few)
    assert (plain.attribute("material")[few] == -1).all()
    threshold, mean = plain.attribute("threshold")[~few], plain.attribute("mean")[~few]
    assert (plain.attribute("minimum")[~few] <= mean).all()
    assert (mean <= threshold).all()
    assert threshold.max() < 100


# Exposure


@pytest.fixture
def varying(tmp_path_factory) -> Path:
    """The same film under an automatic exposure, ±40 %, that EXIF tells."""
    return film(tmp_path_factory, VARYING)


@pytest.fixture
def exposures(varying) -> dict[str, float]:
    record = json.loads((varying.parent / "ground_truth" / "frames.json").read_text())
    return {frame["label"]: frame["exposure"] for frame in record["frames"]}


@pytest.mark.parametrize("source", ["exif", "raster", "none"])
def test_a_varying_exposure_ends_in_the_result_of_a_fixed_one(
    varying, exposures, tmp_path, plain, source
):
    """By EXIF, by the rasters' attributes, or fitted where neither is there.

    Measured: exposures off by 3e-5, 0 and .023 (ln, the worst); D by 1.4, 1.4, 1.7 % (median);
    lights as the coarse map shows them, before any refinement, by .38°.
    """

    def edit(project: Project) -> None:
        for raster in project.rasters:
            raster.mask = None
            raster.exposure = 7 * exposures[raster.label] if source == "raster" else None

    document = Document.open(edited(varying, tmp_path / "in", edit), tmp_path / "out")
    given = {SAMPLES: {"exposure": "none"}} if source == "none" else {}
    said = run(document, LIGHTS, **sized(WALK, **given))[SAMPLES].message
    record = document.json("frames")
    assert record["exposure"] == source
    assert record["gains_fitted"] == (source == "none")
    if source == "none":
        assert "brightness varies by 29%: a gain per frame and channel is fitted" in said
    else:
        assert f"exposure: {source}" in said
        assert "varies" not in said

    gain = np.array([frame["gain"] for frame in record["frames"]])
    error = np.abs(np.log(gain / np.array(list(exposures.values()))[:, None]))
    assert error.max() < {"exif": 1e-4, "raster": 1e-12, "none": 0.035}[source]
    ratio = np.log(document.attribute("diffuse") / plain.attribute("diffuse"))
    assert np.nanmedian(np.abs(ratio)) < 0.025
    found = [[x["direction"] for x in d.json("lights_found")["lights"]] for d in (document, plain)]
    assert angle(*np.array(found)).max() < 0.45


def test_gains_are_left_alone_where_that_is_asked_for(varying, tmp_path):
    document = Document.open(varying, tmp_path)
    said = run(document, SAMPLES, **small({"exposure": "none", "gains": "none"}))
    assert "left as it is (gains=none)" in said[SAMPLES].message
    assert all(frame["gain"] == [1, 1, 1] for frame in frames(document).values())


def test_gains_fitted_to_a_fixed_exposure_are_1(walk, tmp_path):
    document = Document.open(walk, tmp_path)
    run(document, SAMPLES, **small({"gains": "fit"}))
    gain = np.array([frame["gain"] for frame in frames(document).values()])
    assert np.abs(np.log(gain)).max() < 0.05  # measured .03


def test_exposures_that_not_every_frame_has_are_not_used(varying, walk, tmp_path):
    def most(project: Project) -> None:
        for raster in project.rasters[1:]:
            raster.exposure = 1.0

    document = Document.open(edited(varying, tmp_path / "in", most), tmp_path / "a")
    with pytest.raises(DocumentError, match=r"without svbrdf_exposure: low_000\.jpg"):
        run(document, SAMPLES, **small({"exposure": "raster"}))
    run(document, SAMPLES, **small({}))
    assert document.json("frames")["exposure"] == "exif"
    document = Document.open(walk, tmp_path / "b")
    with pytest.raises(DocumentError, match=r"without EXIF exposure: low_000\.jpg"):
        run(document, SAMPLES, **small({"exposure": "exif"}))


# Masks


def small(given: dict) -> dict[str, dict]:
    """Parameters for a look at the frames alone."""
    return {TEXELS: {"texture_size": 48}, SAMPLES: given}


def test_masks_keep_samples_off_what_is_not_the_object(varying, tmp_path):
    """Silhouettes as masks cost hardly a sample at the borders; a black mask all of its frame's."""
    free = edited(
        varying, tmp_path / "free", lambda p: [setattr(r, "mask", None) for r in p.rasters]
    )
    without = Document.open(free, tmp_path / "a")
    run(without, SAMPLES, **small({}))
    masked = Document.open(varying, tmp_path / "b")
    run(masked, SAMPLES, **small({}))
    counts = [d.attribute("frames").astype(int) for d in (without, masked)]
    assert 0.93 < counts[1].sum() / counts[0].sum() <= 1

    black = tmp_path / "black.png"
    write_png(black, np.zeros((WALK.height, WALK.width), np.uint8))

    def cover(project: Project) -> None:
        project.rasters[4].mask = black

    document = Document.open(edited(varying, tmp_path / "in", cover), tmp_path / "c")
    run(document, SAMPLES, **small({}))
    covered, before = frames(document)["low_004.jpg"], frames(masked)["low_004.jpg"]
    assert covered["samples"] == 0 < before["samples"]
    assert covered["residual"] is None
    assert document.attribute("frames").sum() == counts[1].sum() - before["samples"]
    write_png(black, np.zeros((5, 6), np.uint8))
    with pytest.raises(DocumentError, match=r"mask of raster 'low_004.jpg'.*has 6×5 pixels"):
        run(document, SAMPLES, **small({}))


# Frames that cannot be used


def missing(path: Path) -> None:
    path.unlink()


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def scaled(path: Path) -> None:
    write_png(path.with_suffix(".png"), np.zeros((80, 60, 3), np.uint8))
    path.with_suffix(".png").replace(path)


def no_image(path: Path) -> None:
    path.write_text("a frame")


def empty(path: Path) -> None:
    path.write_bytes(b"")


BROKEN = {
    missing: ("1 of 60 frames .*low_003.jpg does not exist.*unreadable=skip", "does not exist"),
    empty: ("1 of 60 frames .*low_003.jpg is empty", "is empty"),
    truncated: ("'low_003.jpg': .*the image is cut off", "the image is cut off"),
    scaled: ("'low_003.jpg': .*has 60×80 pixels, its camera's ViewportPx says 120×160", "60×80"),
    no_image: ("1 of 60 frames .*low_003.jpg is not an image", "is not an image"),
}


@pytest.mark.parametrize("break_it", BROKEN, ids=lambda function: function.__name__)
def test_frames_that_cannot_be_read_are_named_or_left_out(walk, tmp_path, break_it):
    stops, left_out = BROKEN[break_it]
    frame = tmp_path / "low_003.jpg"
    shutil.copy(walk.parent / "low" / frame.name, frame)
    break_it(frame)

    def replace_it(project: Project) -> None:
        project.rasters[3].path = frame

    document = Document.open(edited(walk, tmp_path / "in", replace_it), tmp_path / "out")
    document.apply(TEXELS, texture_size=48)
    before = contents(document.folder)
    with pytest.raises(DocumentError, match=stops):
        document.apply(SAMPLES)
    assert contents(document.folder) == before
    said = document.apply(SAMPLES, unreadable="skip").message
    assert "59 frames" in said
    assert said.endswith("left out, unreadable: low_003.jpg")
    record = frames(document)
    assert len(record) == 60
    assert left_out in record["low_003.jpg"]["left_out"]
    assert sum("samples" in entry for entry in record.values()) == 59
    assert not document.apply(THRESHOLD).skipped


def test_all_unusable_frames_are_named_at_once(walk, tmp_path):
    def break_four(project: Project) -> None:
        for k, break_it in enumerate((missing, empty, no_image, missing)):
            project.rasters[5 * k].path = tmp_path / f"frame_{k}.jpg"
            shutil.copy(walk.parent / "low/low_003.jpg", project.rasters[5 * k].path)
            break_it(project.rasters[5 * k].path)

    document = Document.open(edited(walk, tmp_path / "in", break_four), tmp_path / "out")
    document.apply(TEXELS, texture_size=48)
    found = (
        r"4 of 60 .*frame_0.jpg does not exist; .*frame_1.jpg is empty; .*frame_2.jpg is not an "
        r"image.*frame_3.jpg does not exist"
    )
    with pytest.raises(DocumentError, match=found):
        document.apply(SAMPLES)


def test_frames_that_are_all_missing_and_cameras_that_see_nothing(walk, tmp_path):
    def lose(project: Project) -> None:
        for raster in project.rasters:
            raster.path = raster.path.with_name("gone.jpg")

    document = Document.open(edited(walk, tmp_path / "lost", lose), tmp_path / "a")
    with pytest.raises(SvbrdfError, match="no frame is left to sample"):
        run(document, SAMPLES, **small({"unreadable": "skip"}))

    def turn_away(project: Project) -> None:
        turn = np.diag([-1.0, 1, -1])
        for raster in project.rasters:
            camera = raster.camera
            raster.camera = replace(camera, R=turn @ camera.R, t=turn @ camera.t)

    document = Document.open(edited(walk, tmp_path / "away", turn_away), tmp_path / "b")
    with pytest.raises(SvbrdfError, match=r"no texel is seen .* aligned to this mesh"):
        run(document, SAMPLES, **small({}))
    assert not document.has("samples")


# Which frames, in which order


def test_every_n_th_frame_of_each_sequence(walk, tmp_path):
    document = Document.open(walk, tmp_path)
    said = run(document, SAMPLES, **small({"step": 4}))[SAMPLES].message
    used = [label for label, frame in frames(document).items() if "samples" in frame]
    assert used == [f"{name}_{k:03d}.jpg" for name in ("low", "high") for k in range(0, 30, 4)]
    assert document.json("frames")["median_step_degrees"] == pytest.approx(44, abs=3)
    assert "stills, 4" in said
    others = [frame for label, frame in frames(document).items() if label not in used]
    assert {frame["left_out"] for frame in others} == {"one frame in 4 is used"}
    np.testing.assert_array_equal(document.array("samples_order"), 2 * list(range(8)))
    np.testing.assert_array_equal(document.array("samples_sequence"), np.repeat([0, 1], 8))


def test_held_out_frames_are_not_sampled(walk, tmp_path):
    document = Document.open(walk, tmp_path)
    document.hold_out()
    run(document, SAMPLES, **small({}))
    record = frames(document)
    held_out = {label for label, frame in record.items() if frame.get("left_out") == "held out"}
    assert held_out == {raster.label for raster in document.held_out}
    assert len(held_out) == 8  # of 60: the 4th, the 12th …
    assert sum("samples" in frame for frame in record.values()) == 52


@pytest.mark.parametrize("how", ["interleaved", "shuffled"])
def test_the_order_of_rasters_does_not_matter_where_peaks_do_not(walk, plain, tmp_path, how):
    def reorder(project: Project) -> None:
        order = np.arange(60).reshape(2, 30).T.ravel()
        if how == "shuffled":
            order = np.random.default_rng(0).permutation(60)
        project.rasters = [project.rasters[k] for k in order]

    document = Document.open(edited(walk, tmp_path / "in", reorder), tmp_path / "out")
    run(document, LIGHTS, **sized(WALK))
    tolerance = 0 if how == "interleaved" else 1e-4  # of 100
    for name in ("frames", "threshold", "mean_color", "diffuse"):
        expected = plain.attribute(name)
        np.testing.assert_allclose(document.attribute(name), expected, rtol=0, atol=tolerance)
    found = [[x["direction"] for x in d.json("lights_found")["lights"]] for d in (document, plain)]
    assert angle(*np.array(found)).max() < 1e-5


@pytest.mark.parametrize("given", [{"spacing": 5}, {"frames": 12}, {"spacing": 5, "frames": 12}])
def test_a_film_whose_camera_stands_still_is_used_and_nothing_is_divided_by_its_step(
    walk, tmp_path, given
):
    def stand(project: Project) -> None:
        for raster in project.rasters:
            raster.camera, raster.path = project.rasters[0].camera, project.rasters[0].path

    document = Document.open(edited(walk, tmp_path / "in", stand), tmp_path / "out")
    run(document, SAMPLES, **small(given))
    record = document.json("frames")
    assert record["median_step_degrees"] == 0
    assert not record["stills"]
    used = [frame for frame in record["frames"] if "samples" in frame]
    assert len({frame["samples"] for frame in used}) == 1
    assert len(used) >= (1 if "frames" in given else 60)


def test_stricter_quality_keeps_fewer_samples(walk, tmp_path):
    document = Document.open(walk, tmp_path)
    totals = []
    for given in ({"minimum_quality": 0}, {}, {"minimum_quality": 0.3}, {"border": 20}):
        run(document, SAMPLES, **small(given))
        totals.append(int(document.attribute("frames").sum()))
    assert totals[0] > totals[1] > totals[2]
    assert totals[1] > totals[3]


# What does not belong together


def shifted(pixels: float):
    """An edit of a project: every camera's picture that many columns to the right."""

    def edit(project: Project) -> None:
        for raster in project.rasters:
            raster.camera = replace(raster.camera, cx=raster.camera.cx + pixels)

    return edit


def said_of(path: Path, folder: Path) -> tuple[str, dict]:
    document = Document.open(path, folder)
    outcome = run(document, SAMPLES, **sized(WALK))[SAMPLES]
    return outcome.message, document.json("frames")


def test_a_right_film_is_said_to_be_nothing_else(plain):
    record = plain.json("frames")
    assert record["outline"]["pixels"] <= 1.5
    assert record["outline"]["agreement"] > 0.35
    assert record["outline"]["frames"] == 12
    assert record["light_change"]["sides"] < 0.03
    message = plain.results.record["runs"][SAMPLES]["message"]
    assert "outline" not in message
    assert "light changed" not in message


def test_cameras_that_are_off_are_told_with_the_pixels(walk, tmp_path):
    wide = edited(walk, tmp_path / "in", shifted(-8))  # 20 pixels of 640 are 4 of these
    message, record = said_of(wide, tmp_path / "out")
    assert "the object's outline lies 8 pixels off in the frames: the cameras are wrong" in message
    assert record["outline"]["pixels"] == pytest.approx(8, abs=1)


def test_a_mesh_of_another_object_is_told(walk, tmp_path):
    mesh = sphere(24)
    other = with_mesh(
        walk, tmp_path / "in", replace(mesh, vertices=mesh.vertices * [0.9, 0.3, 0.6])
    )
    message, record = said_of(other, tmp_path / "out")
    assert "the object's outline is not found in the frames (agreement 0." in message
    assert record["outline"]["agreement"] < 0.3


@pytest.mark.parametrize(
    ("sides", "turns", "told"), [(0.19, 0.03, True), (0.19, 0.1, False), (0.03, 0.0, False)]
)
def test_light_that_changed_is_told_with_how_much(walk, tmp_path, monkeypatch, sides, turns, told):
    """But of gold, which looks another from everywhere, and of what steady light does."""
    found = Steadiness(sides, turns)
    monkeypatch.setattr(compute_svbrdf_samples, "light_steadiness", lambda *_: found)
    message, record = said_of(walk, tmp_path / "out")
    assert ("one side of the object is 21% brighter than in the first" in message) == told
    assert record["light_change"] == {"sides": sides, "turns": turns}


def test_wrong_cameras_are_not_blamed_on_the_light(walk, tmp_path, monkeypatch):
    monkeypatch.setattr(compute_svbrdf_samples, "light_steadiness", lambda *_: Steadiness(0.2, 0))
    message, _ = said_of(edited(walk, tmp_path / "in", shifted(-8)), tmp_path / "out")
    assert "the cameras are wrong" in message
    assert "light changed" not in message


def test_too_few_photographs_go_through_and_tell_what_they_lack(walk, tmp_path):
    """With six frames no texel has eight samples; with three asked of each many have enough."""
    document = Document.open(walk, tmp_path)
    given = {TEXELS: {"texture_size": 48}, SAMPLES: {"frames": 6}}
    said = run(document, **given)
    assert "stills, " in said[SAMPLES].message
    assert said[THRESHOLD].message.startswith("0.0 % of the texels observed; ")
    assert "were seen, but by fewer than 8 frames well enough: take more" in said[THRESHOLD].message
    assert "be content with fewer (minimum_samples=4)" in said[THRESHOLD].message
    assert not np.isfinite(document.attribute("final_diffuse")).any()
    assert document.json("materials")["materials"] == []

    few = document.apply(THRESHOLD, minimum_samples=3).message
    samples, seen = document.attribute("samples"), np.isfinite(document.attribute("threshold"))
    np.testing.assert_array_equal(seen, samples >= 3)
    assert 0.2 < seen.mean() < 1
    assert "fewer than 3 frames" in few
    assert "minimum_samples" not in few
