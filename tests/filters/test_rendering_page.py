"""generate_svbrdf_rendering: names of files, grey around the object, what it refuses."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scores import KERNEL, psnr
from totems import GLOSS, VIDEO, contents, copied, edited, film

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.document.project import Project, new_project, write_project
from meshlab_svbrdf.errors import DocumentError, SvbrdfError

RENDER = "generate_svbrdf_rendering"


@pytest.fixture
def views(tmp_path_factory) -> Path:
    return film(tmp_path_factory, VIDEO).parent / "ground_truth" / "views" / "project.mlp"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, VIDEO, tmp_path / "result")


def test_views_are_named_as_their_rasters_and_grey_around_the_object(result, views, tmp_path):
    before = contents(result.folder)
    said = result.apply(RENDER, cameras=views, folder=tmp_path / "new" / "folder")
    assert said.message == f"1 views in {tmp_path / 'new' / 'folder'}"
    assert [p.name for p in (tmp_path / "new" / "folder").iterdir()] == ["view_00.png"]
    image = read_image(tmp_path / "new" / "folder" / "view_00.png")
    true = read_image(views.parent / "view_00.png")
    assert image.shape == true.shape
    assert image.dtype == np.uint8
    backdrop = (true == true[0, 0]).all(-1).astype(np.uint8)
    backdrop = cv2.erode(cv2.morphologyEx(backdrop, cv2.MORPH_OPEN, KERNEL), KERNEL) > 0
    assert backdrop.mean() > 0.3
    assert (image[backdrop] == 118).all()
    assert psnr(image, true)[0] > 31.5  # measured 32.3
    assert contents(result.folder) == before
    assert not result.apply(RENDER, cameras=views, folder=tmp_path / "new" / "folder").skipped


def test_without_cameras_the_frames_own_are_used(result, tmp_path):
    assert result.apply(RENDER, folder=tmp_path, supersampling=1).message.startswith("90 views")
    names = {path.name for path in tmp_path.glob("*.png")}
    assert names == {f"low_{k:03d}.png" for k in range(90)}


def test_it_shows_the_last_estimators_maps(result, views, tmp_path):
    result.apply(RENDER, cameras=views, folder=tmp_path / "joint")
    result.apply(GLOSS, estimator="paper")
    result.apply(RENDER, cameras=views, folder=tmp_path / "paper")
    joint, paper = (read_image(tmp_path / name / "view_00.png") for name in ("joint", "paper"))
    assert (joint != paper).any()
    plain = tmp_path / "unshadowed"
    result.apply(RENDER, cameras=views, folder=plain, shadows=False)
    brighter = read_image(plain / "view_00.png").astype(int) - paper
    assert brighter.min() >= 0
    assert brighter.max() > 10


def test_microfacets_are_shown_unless_the_lobe_is_asked_for(result, views, tmp_path):
    """The first observed material gets some, in its JSON only; D is the same in both."""

    def show(name: str, **options) -> np.ndarray:
        result.apply(RENDER, cameras=views, folder=tmp_path / name, **options)
        return read_image(tmp_path / name / "view_00.png")

    before = show("before")
    path = result.folder / "materials.json"
    told = json.loads(path.read_text())
    material = next(m for m in told["materials"] if m["observed"])
    material["reflectance"] = {
        "model": "ggx", "strength": 1.0, "roughness": 0.3, "f0": 0.5, "color": [1, 1, 1],
        "gain_db": 3.0,
    }  # fmt: skip
    path.unlink()  # it is linked to the one that other tests read
    path.write_text(json.dumps(told))
    np.testing.assert_array_equal(show("phong", reflectance="phong"), before)
    assert (show("best") != before).any()


def test_what_it_refuses(result, views, tmp_path):
    with pytest.raises(SvbrdfError, match="folder is empty: say where the images go"):
        result.apply(RENDER, cameras=views)
    with pytest.raises(DocumentError, match=r"nowhere\.mlp"):
        result.apply(RENDER, cameras=tmp_path / "nowhere.mlp", folder=tmp_path)
    write_project(new_project(), tmp_path / "empty.mlp")
    with pytest.raises(SvbrdfError, match="has no rasters to take cameras from"):
        result.apply(RENDER, cameras=tmp_path / "empty.mlp", folder=tmp_path)

    def twice(project: Project) -> None:
        first = project.rasters[0]
        project.add_raster("again", tmp_path / "view_00.jpg", first.camera)

    both = edited(views, tmp_path / "in", twice)
    with pytest.raises(SvbrdfError, match="two rasters have the same file name"):
        result.apply(RENDER, cameras=both, folder=tmp_path / "out")
    assert not (tmp_path / "out").exists()
