"""The registration with its real core, in a script and in the shell, on the totem's film."""

import numpy as np
import pytest
from films import write_video
from totems import VIDEO, edited, film
from typer.testing import CliRunner

from meshlab_svbrdf import MeshSet, cli
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.script import Step, write_script

TRACK = "generate_svbrdf_registered_rasters"
COUNT = 16
NEAR = 2.0  # pixels, of pictures 150 wide


@pytest.fixture
def truth(tmp_path_factory):
    return read_project(film(tmp_path_factory, VIDEO)).rasters[:COUNT]


@pytest.fixture
def project(tmp_path_factory, tmp_path):
    """The scan, and the first raster."""
    source = film(tmp_path_factory, VIDEO)
    return edited(source, tmp_path / "in", lambda p: p.rasters.__setitem__(slice(1, None), []))


def errors(document, rasters, truth):
    """Pixels RMS by which each camera sees the vertices away from where the true one does."""
    vertices = document.mesh().vertices[::20]
    off = [
        np.linalg.norm(
            r.camera.project(vertices)[:, :2] - t.camera.project(vertices)[:, :2], axis=1
        )
        for r, t in zip(rasters, truth, strict=True)
    ]
    return np.sqrt(np.mean(np.square(off), axis=1))


def test_a_film_is_registered_from_its_first_camera_by_a_script(project, truth, tmp_path):
    """The start's file is the film's first, so its raster is replaced by the same frame's."""
    folder = truth[0].path.parent
    given = {"images": str(folder), "start": truth[0].label, "last": str(COUNT - 1)}
    write_script(tmp_path / "chain.mlx", [Step(TRACK, given)])
    ms = MeshSet()
    ms.load_project(project)
    ms.apply_filter_script(tmp_path / "chain.mlx")
    assert ms.raster_number() == COUNT
    ms.save_project(tmp_path / "saved.mlp")
    document = Document.open(tmp_path / "saved.mlp")
    assert [r.label for r in document.rasters] == [r.label for r in truth]
    assert errors(document, document.rasters, truth).max() < NEAR
    told = document.json("registration")["clips"][0]["frames"]
    assert all(frame["status"] == "registered" for frame in told)
    assert max(frame["residual"] for frame in told) < 1
    assert all(0 <= frame["blur"] <= 1 for frame in told)


def test_a_video_is_registered_in_the_shell(project, truth, tmp_path):
    video = write_video(tmp_path / "walk.mp4", [read_frame(raster.path) for raster in truth])
    words = ["register", project, "--video", video, "--start", truth[0].label, "-o", tmp_path / "o"]
    result = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    assert f"{COUNT} of {COUNT} frames registered" in result.stdout
    document = Document.open(tmp_path / "o" / project.name)
    assert errors(document, document.rasters[1:], truth).max() < NEAR
