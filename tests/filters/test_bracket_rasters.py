"""Exposures of which one has a camera become brackets, as if they had been added by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational
from totems import SAMPLES, TEXELS, WALK, edited, film

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame
from meshlab_svbrdf.document.project import Project, read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters._stages import read_observations
from meshlab_svbrdf.samples.luminance import decode, encode

BRACKETS = "generate_svbrdf_bracket_rasters"
VIEWS, EXPOSURES = 6, (1.0, 0.25, 4.0)


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    return film(tmp_path_factory, replace(WALK, frames=12))


@pytest.fixture(scope="module")
def shots(source, tmp_path_factory) -> Path:
    """A folder of three exposures of each view, which EXIF tells."""
    folder = tmp_path_factory.mktemp("brackets") / "shots"
    folder.mkdir()
    for number, raster in enumerate(read_project(source).rasters[:VIEWS]):
        light = decode(read_frame(raster.path) / 255)
        for k, exposure in enumerate(EXPOSURES):
            exif = Image.Exif()
            tags = exif.get_ifd(ExifTags.IFD.Exif)
            tags[ExifTags.Base.ExposureTime] = IFDRational(round(1000 * exposure), 50_000)
            tags[ExifTags.Base.FNumber] = IFDRational(8, 1)
            tags[ExifTags.Base.ISOSpeedRatings] = 100
            codes = np.rint(255 * encode(np.clip(exposure * light, 0, 1))).astype(np.uint8)
            name = f"view{number}_{k}.jpg"  # without zeros: in natural order
            Image.fromarray(codes).save(folder / name, quality=100, exif=exif)
    return folder


def project(source: Path, folder: Path, shots: Path, which: dict[int, list[int]]) -> Document:
    """The film's mesh with some exposures (by view) as rasters."""

    def edit(project: Project) -> None:
        cameras = [raster.camera for raster in project.rasters]
        project.rasters[:] = []
        for view, own in which.items():
            for k in own:
                path = shots / f"view{view}_{k}.jpg"
                # What a reconstruction finds for each: nearly the same
                moved = replace(cameras[view], t=cameras[view].t + 1e-3 * k)
                project.add_raster(path.name, path, moved, sequence="walk")

    return Document.open(edited(source, folder, edit), folder)


def sampled(document: Document) -> tuple[np.ndarray, str]:
    document.apply(TEXELS, texture_size=64)
    said = document.apply(SAMPLES, gains="none", white=1.0).message
    seen = read_observations(document, visibility=False)
    block = seen.store.read(0, seen.store.texels)
    return seen.view.linear[block.rgb] * seen.view.scale[block.frame], said


def test_one_camera_a_view_is_enough_and_the_middle_ones_counts(source, shots, tmp_path):
    every = {view: [0, 1, 2] for view in range(VIEWS)}
    some = {view: [0] if view % 2 else [1, 0] for view in range(VIEWS)}
    one = project(source, tmp_path / "one", shots, some)
    said = one.apply(BRACKETS, images=shots).message
    assert said == f"{VIEWS} views of 3 exposures"
    all_ = project(source, tmp_path / "all", shots, every)
    all_.apply(BRACKETS, images=shots, exposures="1; .25; 4")
    names = [f"view{view}_{k}.jpg" for view in range(VIEWS) for k in range(3)]
    for document in (one, all_):
        document.save()
        again = Document.open(document.path, document.path.parent).project.rasters
        assert [raster.label for raster in again] == names
        assert {raster.sequence for raster in again} == {"walk"}
        told = np.array([raster.exposure for raster in again]).reshape(VIEWS, 3)
        np.testing.assert_allclose(told / told[:, :1], [EXPOSURES] * VIEWS)
    color, said = sampled(one)
    assert f"{3 * VIEWS} exposures are merged to {VIEWS} views" in said
    expected, _ = sampled(all_)
    np.testing.assert_array_equal(color, expected)


def test_a_view_without_a_camera_is_named_and_left_out(source, shots, tmp_path):
    document = project(source, tmp_path, shots, {0: [1], 2: [0]})
    said = document.apply(BRACKETS, images=shots).message
    assert said.startswith("2 views of 3 exposures; left out, none of their exposures has a camera")
    assert "4 views (view1_0.jpg, view3_0.jpg" in said
    assert len(document.project.rasters) == 6


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"count": 4}, "holds 18 images, which are no views of 4 exposures"),
        ({"exposures": "1; 2"}, "expected 3 numbers above 0 that differ"),
        ({"exposures": "1 1 1"}, "expected 3 numbers above 0 that differ"),
        ({"exposures": "1 x 2"}, "expected 3 numbers above 0 that differ"),
        ({"images": None}, "images=FOLDER"),
    ],
)
def test_what_is_no_bracket_is_refused(source, shots, tmp_path, given, expected):
    document = project(source, tmp_path, shots, {0: [0]})
    before = list(document.project.rasters)
    with pytest.raises(SvbrdfError, match=expected):
        document.apply(BRACKETS, **{"images": shots} | {k: v or "" for k, v in given.items()})
    assert document.project.rasters == before


def test_images_that_tell_no_exposure_or_the_same_one_are_refused(source, shots, tmp_path):
    silent, alike = tmp_path / "silent", tmp_path / "alike"
    for folder in (silent, alike):
        folder.mkdir()
        for k in range(3):
            with Image.open(shots / f"view0_{k if folder == silent else 0}.jpg") as image:
                exif = b"" if folder == silent else image.getexif()
                image.save(folder / f"view0_{k}.jpg", exif=exif)
    document = project(source, tmp_path / "a", silent, {0: [0]})
    with pytest.raises(SvbrdfError, match=r"view0_0\.jpg: tells no exposure"):
        document.apply(BRACKETS, images=silent)
    document = project(source, tmp_path / "b", alike, {0: [0]})
    with pytest.raises(SvbrdfError, match="have one exposure, and are no bracket"):
        document.apply(BRACKETS, images=alike)
    with pytest.raises(SvbrdfError, match="none of its 18 images is a raster of the project"):
        document.apply(BRACKETS, images=shots)
