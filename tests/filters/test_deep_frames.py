"""Frames of more than 8 bits: the same light gives the same samples, whatever holds it."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from films import write_video
from totems import SAMPLES, TEXELS, WALK, edited, film

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_frame, write_exr, write_png
from meshlab_svbrdf.document.project import Project, read_project
from meshlab_svbrdf.document.project_entries import RasterEntry
from meshlab_svbrdf.document.video_rasters import add_video
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.filters._samples import read_samples
from meshlab_svbrdf.filters._stages import read_observations
from meshlab_svbrdf.samples.luminance import decode, encode
from meshlab_svbrdf.samples.transfer import encode as signal_of

FILM = replace(WALK, frames=12)
EXPOSURES = (1.0, 0.25, 4.0)


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    return film(tmp_path_factory, FILM)


def light_of(raster: RasterEntry) -> np.ndarray:
    """Linear light as the film's JPEG tells it."""
    return decode(read_frame(raster.path) / 255).astype(np.float32)


def opened(path: Path) -> Document:
    document = Document.open(path, path.parent)
    document.apply(TEXELS, texture_size=64)
    return document


def recorded(
    source: Path, folder: Path, suffix: str, write: Callable[[Path, np.ndarray], object]
) -> Document:
    """The film with frames that `write` made of their light."""

    def edit(project: Project) -> None:
        rasters, project.rasters[:] = list(project.rasters), []
        for raster in rasters:
            path = folder / f"{raster.path.stem}{suffix}"
            write(path, light_of(raster))
            project.add_raster(raster.label, path, raster.camera, sequence=raster.sequence)

    folder.mkdir()
    return opened(edited(source, folder, edit))


def samples_of(document: Document, **given) -> tuple[np.ndarray, np.ndarray, str]:
    """Linear colours, 0..1, and marks of all samples, and the outcome."""
    said = document.apply(SAMPLES, **{"gains": "none", "memory": 16, **given}).message
    seen = read_observations(document, visibility=False)
    block = seen.store.read(0, seen.store.texels)
    color = seen.view.linear[block.rgb] * seen.view.scale[block.frame] / 100
    return color, block.quality, said


@pytest.fixture(scope="module")
def plain(source, tmp_path_factory):
    """The samples of the film as it is."""
    document = Document.open(source, tmp_path_factory.mktemp("plain"))
    document.apply(TEXELS, texture_size=64)
    return samples_of(document)


def write_hdr(path: Path, light: np.ndarray) -> None:
    cv2.imwrite(str(path), np.ascontiguousarray(light[..., ::-1]))


def write_16(curve: str) -> Callable[[Path, np.ndarray], None]:
    def write(path: Path, light: np.ndarray) -> None:
        codes = np.rint(65535 * np.clip(signal_of(light, curve), 0, 1)).astype(np.uint16)
        if path.suffix == ".png":
            write_png(path, codes)
        else:
            cv2.imwrite(str(path), codes[..., ::-1])

    return write


@pytest.mark.parametrize(
    ("suffix", "write", "transfer", "error"),
    [
        (".exr", write_exr, "auto", 0.001),
        (".hdr", write_hdr, "auto", 0.01),  # eight bits of fraction, one exponent for three
        (".png", write_16("srgb"), "auto", 0.001),
        (".tif", write_16("linear"), "linear", 0.001),
        (".png", write_16("slog3"), "slog3", 0.001),
        (".png", write_16("pq"), "pq", 0.001),
    ],
)
def test_the_same_light_gives_the_same_samples(
    plain, source, tmp_path, suffix, write, transfer, error
):
    document = recorded(source, tmp_path / "deep", suffix, write)
    color, marks, said = samples_of(document, transfer=transfer)
    expected, old_marks, _ = plain
    assert "samples of 16 bits" in said
    np.testing.assert_array_equal(marks & 127, old_marks & 127)  # quality is geometry alone
    # The 8-bit store rounds to codes: half a one, and what these frames round
    half = (decode((encode(expected) * 255 + 0.51) / 255) - expected).clip(2e-4)
    scale = expected.max(-1, keepdims=True) + 0.02
    assert (np.abs(color - expected) <= half + error * scale).all()
    assert not (suffix in (".exr", ".hdr") and (marks & 128).any())


def test_exposures_in_headers_are_divided_out_where_they_are_sure_or_asked_for(
    plain, source, tmp_path
):
    def exposed(path: Path) -> float:
        return EXPOSURES[int(re.findall(r"\d+", path.stem)[-1]) % 3]

    def radiance(path: Path, light: np.ndarray) -> None:
        write_hdr(path, exposed(path) * light)
        head, _, pixels = path.read_bytes().partition(b"\n\n")
        path.write_bytes(head + b"\nEXPOSURE=%g\n\n" % exposed(path) + pixels)

    def exr(path: Path, light: np.ndarray) -> None:
        tags = {"expTime": exposed(path), "isoSpeed": 100.0, "aperture": 10.0}
        OpenEXR.File(tags, {"RGB": exposed(path) * light}).write(str(path))

    for suffix, write, asked in ((".hdr", radiance, "auto"), (".exr", exr, "exif")):
        document = recorded(source, tmp_path / suffix[1:], suffix, write)
        color, _, said = samples_of(document, exposure=asked, white=1)
        assert "exposure: exif" in said
        scale = plain[0].max(-1, keepdims=True) + 0.02
        assert np.median(np.abs(color - plain[0]) / scale) < 0.01
    _, _, said = samples_of(document, white=1)
    assert "exposures up to 16 times apart, which are not used" in said


def test_light_beyond_white_is_kept_and_the_unit_told(source, tmp_path):
    document = recorded(
        source, tmp_path / "bright", ".exr", lambda path, light: write_exr(path, 1000 * light)
    )
    color, marks, said = samples_of(document)
    white = document.json("frames")["coding"]["white"]
    assert np.log2(white) == round(np.log2(white))
    assert 500 <= white <= 1024
    assert f"a light of {white:g} 1" in said
    assert not (marks & 128).any()
    raster = document.rasters[0]
    with Frames([raster]) as frames:
        assert frames.light(raster).radiance.max() > 500
        assert frames.read(raster).dtype == np.uint8
    fixed, _, _ = samples_of(document, white=1.0)
    np.testing.assert_allclose(fixed, white * color, rtol=1e-6)
    assert (samples_of(document, clip=200.0)[1] & 128).any()


def test_floats_that_look_clipped_are_told(source, tmp_path):
    def write(path: Path, light: np.ndarray) -> None:
        write_exr(path, np.minimum(light, np.float32(0.25)))

    document = recorded(source, tmp_path / "flat", ".exr", write)
    assert "if the frames end there, say clip=0.25" in samples_of(document)[2]
    _, marks, said = samples_of(document, clip=0.25)
    assert (marks & 128).any()
    assert "clip=" not in said


def test_brackets_are_merged_to_their_views(plain, source, tmp_path):
    """Three exposures of 8 bits show what the middle one clips."""

    def edit(project: Project) -> None:
        rasters, project.rasters[:] = list(project.rasters), []
        for raster in rasters:
            for e in EXPOSURES:
                path = tmp_path / "shots" / f"{raster.path.stem}_{e:g}.png"
                codes = np.rint(255 * encode(np.clip(2 * e * light_of(raster), 0, 1)))
                write_png(path, codes.astype(np.uint8))
                project.add_raster(
                    path.stem, path, raster.camera, sequence=raster.sequence, exposure=e
                )

    (tmp_path / "shots").mkdir()
    document = opened(edited(source, tmp_path / "shots", edit))
    color, marks, said = samples_of(document, white=2.0)
    assert f"{3 * FILM.frames} exposures are merged to {FILM.frames} views" in said
    expected, old_marks, _ = plain
    assert not (marks & 128).any()
    shown = (old_marks & 128) == 0
    error = np.abs(encode(color) - encode(expected))[shown]
    assert error.mean() < 1 / 255
    told = document.json("frames")["frames"]
    assert [len(f["merged"]) for f in told if "samples" in f] == [3] * FILM.frames
    assert sum("merged to" in f.get("left_out", "") for f in told) == 2 * FILM.frames
    # Samples that are not kept are projected again, merged alike
    again, _, _ = samples_of(document, white=2.0, store="memory")
    np.testing.assert_array_equal(again, color)
    fresh = Document.open(document.path, document.path.parent)
    seen = [r for r in fresh.rasters if r.label in {f["label"] for f in told if "samples" in f}]
    assert read_samples(fresh, fresh.mesh(), seen).bits == 16
    # Apart, they are frames like others
    _, marks, said = samples_of(document, brackets="none")
    assert (marks & 128).any()
    assert "merged" not in said
    assert "16 bits" not in said


def test_a_response_is_measured_or_refused(source, tmp_path):
    document = Document.open(source, tmp_path / "a")
    document.apply(TEXELS, texture_size=64)
    with pytest.raises(SvbrdfError, match="no two rasters show the same view"):
        document.apply(SAMPLES, transfer="estimate")

    def edit(project: Project) -> None:
        rasters, project.rasters[:] = list(project.rasters), []
        for raster in rasters[:8]:
            for e in EXPOSURES:
                path = tmp_path / "shots" / f"{raster.path.stem}_{e:g}.png"
                codes = 255 * np.clip(e * light_of(raster), 0, 1) ** 0.6  # no sRGB
                write_png(path, np.rint(codes).astype(np.uint8))
                project.add_raster(
                    path.stem, path, raster.camera, sequence=raster.sequence, exposure=e
                )

    (tmp_path / "shots").mkdir()
    document = opened(edited(source, tmp_path / "shots", edit))
    said = document.apply(SAMPLES, transfer="estimate", gains="none").message
    assert "the camera's response is measured" in said
    response = np.array(document.json("frames")["coding"]["response"])
    codes = np.arange(20, 230)
    expected = (codes / 128) ** (1 / 0.6) * decode(np.array(128 / 255))
    assert np.abs(np.log(response[codes] / expected[:, None])).max() < 0.1


def test_hdr_video_is_read_by_its_tags(source, tmp_path):
    """PQ in BT.2020, ten bits: grey of a known light."""
    rasters = [r for r in read_project(source).rasters if r.sequence == "low"]
    camera = rasters[0].camera
    lights = np.linspace(0.2, 2.0, len(rasters))
    pictures = []
    for light in lights:  # planes of limited range, below each other
        picture = np.full((camera.height * 3 // 2, camera.width), 512, np.uint16)
        picture[: camera.height] = round(64 + 876 * float(signal_of(np.array(light), "pq")))
        pictures.append(picture)
    write_video(
        tmp_path / "a.mkv", pictures, codec="ffv1", pixels="yuv420p10le", source="yuv420p10le",
        options={}, colorspace=9, color_trc=16, color_primaries=9,
    )  # fmt: skip
    project = read_project(source)
    project.rasters[:] = []
    add_video(
        project, tmp_path / "b.svbrdf", tmp_path / "a.mkv",
        {k: raster.camera for k, raster in enumerate(rasters)},
    )  # fmt: skip
    with Frames(project.rasters) as frames:
        for raster, light in zip(project.rasters, lights, strict=True):
            assert frames.told(raster) == ("pq", True)
            found = frames.light(raster)
            np.testing.assert_allclose(found.radiance, light, rtol=0.03)
            assert found.clipped > 40
            assert frames.read(raster).dtype == np.uint8


@pytest.mark.parametrize(
    ("value", "said"), [(np.nan, "nan"), (-0.5, "-0.5"), (np.inf, "inf"), (1e9, "1e")]
)
def test_floats_that_are_no_light_are_refused(source, tmp_path, value, said):
    def write(path: Path, light: np.ndarray) -> None:
        light = light.copy()
        light[7, 5, 1] = value
        write_exr(path, light)

    document = recorded(source, tmp_path / "bad", ".exr", write)
    with pytest.raises(DocumentError, match=rf"1 pixels are no light.*column 5, row 7: .*{said}"):
        document.apply(SAMPLES)


def test_grey_floats_are_colours_and_other_sizes_refused(source, tmp_path):
    document = recorded(
        source, tmp_path / "grey", ".exr", lambda path, light: write_exr(path, light[..., 1])
    )
    color, _, _ = samples_of(document)
    np.testing.assert_array_equal(color[:, 0], color[:, 2])
    document = recorded(
        source, tmp_path / "small", ".exr", lambda path, light: write_exr(path, light[1:])
    )
    with pytest.raises(DocumentError, match="120×159 pixels, its camera's ViewportPx says 120×160"):
        document.apply(SAMPLES)
