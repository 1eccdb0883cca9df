"""compute_svbrdf_materials, and what the user does to its clusters: merge and split."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from totems import GLOSS, MATERIALS, WALK, by_texel, contents, copied, film

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image, write_png
from meshlab_svbrdf.errors import DocumentError, SvbrdfError

MERGE, SPLIT = "apply_svbrdf_material_merge", "apply_svbrdf_material_split"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, WALK, tmp_path / "result")


@pytest.fixture
def truth(tmp_path_factory) -> Path:
    return film(tmp_path_factory, WALK).parent / "ground_truth"


def labels(document: Document) -> np.ndarray:
    """The labels, which map and attribute agree on."""
    found = document.attribute("material")
    (image,) = document.map("material", "png")
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(np.where(found < 0, 255, found), by_texel(document, [image]))
    texels = document.texels()
    (inside,) = texels.to_images(np.ones(len(texels), bool), False)
    assert (image[~inside] == 255).all()
    return found


def world(document: Document, texel: int) -> np.ndarray:
    texels = document.texels()
    return texels.position[texel] + texels.center


def as_text(points: np.ndarray) -> str:
    return "; ".join(" ".join(f"{x:.6f}" for x in point) for point in points)


def test_clusters_follow_the_true_materials(result, truth):
    """Each cluster is nearly of one material; what is unobserved has none."""
    texels, found = result.texels(), labels(result)
    np.testing.assert_array_equal(found < 0, np.isnan(result.attribute("diffuse")[:, 0]))
    true = read_image(truth / "material_id.png")[texels.row, texels.col]
    ids = np.unique(found[found >= 0])
    assert 3 <= len(ids) <= 6
    np.testing.assert_array_equal(ids, np.arange(len(ids)))
    purity = sum(np.bincount(true[found == k]).max() for k in ids) / np.sum(found >= 0)
    assert purity > 0.9  # measured .94
    shown = result.map("materials_shown", "png")[0][texels.row, texels.col]
    colors = [np.unique(shown[found == k], axis=0) for k in ids]
    assert all(len(color) == 1 for color in colors)
    assert len(np.unique(np.concatenate(colors), axis=0)) == len(ids)


def test_a_lower_threshold_tells_more_apart(result):
    before = labels(result).max()
    result.apply(MATERIALS, threshold=4.0)
    assert labels(result).max() > before
    result.apply(MATERIALS, minimum_share=0.4)
    assert labels(result).max() <= 1


def test_an_image_says_which_texel_is_of_what(result, truth, tmp_path):
    texels = result.texels()
    seen = np.isfinite(result.attribute("diffuse")[:, 0])
    said = result.apply(MATERIALS, image=truth / "material_id.png")
    assert said.message.startswith("3 clusters, 87")
    assert said.message.endswith("given by material_id.png")
    true = read_image(truth / "material_id.png").astype(int)[texels.row, texels.col]
    np.testing.assert_array_equal(labels(result), np.where(seen, true, -1))

    # In colours, of twice the size, with a part that has none
    painted = np.zeros((WALK.texture * 2, WALK.texture * 2, 4), np.uint8)
    painted[..., 3] = 255
    painted[: WALK.texture, :, 0] = 250
    painted[:, : WALK.texture, 3] = 0
    write_png(tmp_path / "painted.png", painted)
    assert result.apply(MATERIALS, image=tmp_path / "painted.png").message.startswith("2 clusters")
    half = WALK.texture // 2
    expected = np.where(texels.col < half, -1, np.where(texels.row < half, 1, 0))
    np.testing.assert_array_equal(labels(result), np.where(seen, expected, -1))


def test_the_same_image_is_not_read_twice_and_a_changed_one_is(result, truth, tmp_path):
    ids = read_image(truth / "material_id.png")
    write_png(tmp_path / "ids.png", ids)
    assert not result.apply(MATERIALS, image=tmp_path / "ids.png").skipped
    assert result.apply(MATERIALS, image=tmp_path / "ids.png").skipped
    write_png(tmp_path / "ids.png", ids // 2)
    assert not result.apply(MATERIALS, image=tmp_path / "ids.png").skipped
    assert labels(result).max() == 1
    for value in (0, 1):  # a further texture's image counts, too
        write_png(tmp_path / "ids.1.png", np.full_like(ids, value))
        assert not result.apply(MATERIALS, image=tmp_path / "ids.png").skipped
        assert result.apply(MATERIALS, image=tmp_path / "ids.png").skipped


def test_grey_values_are_the_ids(result, truth, tmp_path):
    ids = read_image(truth / "material_id.png")
    given = np.where(ids == 255, 255, np.uint8(7) + 100 * ids.clip(0, 2)).astype(np.uint8)
    write_png(tmp_path / "ids.png", given)
    result.apply(MATERIALS, image=tmp_path / "ids.png")
    assert set(np.unique(labels(result))) == {-1, 7, 107, 207}
    assert len(np.unique(result.map("materials_shown", "png")[0].reshape(-1, 3), axis=0)) >= 4
    result.apply(GLOSS)
    assert [m["id"] for m in result.json("materials")["materials"]] == [7, 107, 207]


def test_unusable_images_change_nothing(result, tmp_path):
    before = contents(result.folder)
    with pytest.raises(DocumentError, match=r"nothing\.png"):
        result.apply(MATERIALS, image=tmp_path / "nothing.png")
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    write_png(tmp_path / "noise.png", noise)
    with pytest.raises(SvbrdfError, match="colours, expected at most 256"):
        result.apply(MATERIALS, image=tmp_path / "noise.png")
    assert contents(result.folder) == before


# Edits


@pytest.mark.parametrize("by", ["ids", "points"])
def test_merged_clusters_become_the_first_of_them(result, by):
    before = labels(result)
    given = {"ids": "2, 0"}
    if by == "points":  # deep inside each cluster: its texel nearest to its own middle
        position, picked = result.texels().position, []
        for k in (2, 0):
            own = np.flatnonzero(before == k)
            middle = np.median(position[own], axis=0)
            picked.append(own[np.linalg.norm(position[own] - middle, axis=1).argmin()])
        given = {"points": as_text(np.array([world(result, i) for i in picked]))}
    said = result.apply(MERGE, **given).message
    assert said.startswith("merged 2, 0; ")
    np.testing.assert_array_equal(labels(result), np.where(before == 2, 0, before))
    assert not result.apply(GLOSS).skipped  # it was made from the former clusters
    assert {m["id"] for m in result.json("materials")["materials"]} == set(before[before >= 0]) - {
        2
    }


def test_a_second_run_keeps_what_was_merged(result):
    result.apply(MERGE, ids="0 2")
    merged = labels(result)
    again = result.apply(MATERIALS)
    assert (again.skipped, again.message) == (True, "unchanged but for edits (kept)")
    assert [result.apply(GLOSS).skipped for _ in range(2)] == [False, True]
    np.testing.assert_array_equal(labels(result), merged)
    assert not result.apply(MATERIALS, force=True).skipped
    assert (labels(result) == 2).any()


@pytest.mark.parametrize("by", ["id", "stroke"])
def test_a_cluster_is_split_along_a_stroke_and_merged_again(result, truth, by):
    """The glaze, a belt around the belly, cut by a loop into an upper and a lower one."""
    result.apply(MATERIALS, image=truth / "material_id.png")
    before, texels = labels(result), result.texels()
    place = texels.position + texels.center
    glaze = np.flatnonzero(before == 1)
    turn = np.linspace(0, 2 * np.pi, 25)
    loop = np.stack([0.4 * np.sin(turn), np.full(25, -0.12), 0.4 * np.cos(turn)], -1)
    stroke = place[glaze[cKDTree(place[glaze]).query(loop)[1]]]
    given = {"id": 1} if by == "id" else {}
    said = result.apply(SPLIT, stroke=as_text(stroke), **given).message
    assert said.startswith("cluster 1 split; 4 clusters")
    after = labels(result)
    np.testing.assert_array_equal(after[before != 1], before[before != 1])
    assert set(after[before == 1]) == {1, 3}
    upper = place[glaze, 1] > -0.12
    agrees = np.mean((after[glaze] == 3) == upper)
    assert max(agrees, 1 - agrees) > 0.97

    result.apply(MERGE, ids="3 1")
    np.testing.assert_array_equal(labels(result), before)


@pytest.mark.parametrize(
    ("name", "given", "says"),
    [
        (MERGE, {}, "two clusters or more, and none was named"),
        (MERGE, {"ids": "1"}, r"two clusters or more, and \[1\] was named"),
        (MERGE, {"ids": "1 1"}, r"two clusters or more, and \[1\] was named"),
        (MERGE, {"ids": "1 77"}, "there is no material 77; there are: 0, 1"),
        (MERGE, {"ids": "1 two"}, "ids is '1 two', expected whole numbers"),
        (MERGE, {"ids": "1", "points": "9 9 9"}, "off the object"),
        (MERGE, {"points": "1 2"}, "parameter points"),
        (SPLIT, {}, "a stroke needs two points or more"),
        (SPLIT, {"stroke": "0 0 0"}, "a stroke needs two points or more"),
        (MERGE, {"points": "{}; 9 9 9"}, "point 1 .* off the object"),
        (SPLIT, {"stroke": "9 9 9; 8 8 8", "id": 0}, "off the object"),
        (SPLIT, {"stroke": "{}; {}; 9 9 9"}, "point 2 .* off the object"),
        (SPLIT, {"stroke": "{}; {}", "id": 77}, "there is no material 77"),
        (SPLIT, {"stroke": "{}; {}"}, "does not divide"),
    ],
)
def test_edits_that_make_no_sense_change_nothing(result, name, given, says):
    before, found = contents(result.folder), labels(result)
    own = np.flatnonzero(found == 0)
    spot = as_text(world(result, own[len(own) // 2])[None])
    given = {k: v.replace("{}", spot) if isinstance(v, str) else v for k, v in given.items()}
    with pytest.raises(SvbrdfError, match=says):
        result.apply(name, **given)
    assert contents(result.folder) == before


def test_points_where_nothing_was_observed_are_no_cluster(result):
    before = contents(result.folder)
    nowhere, somewhere = (np.flatnonzero(labels(result) == k)[0] for k in (-1, 0))
    points = as_text(np.array([world(result, nowhere), world(result, somewhere)]))
    with pytest.raises(SvbrdfError, match="unobserved"):
        result.apply(MERGE, points=points)
    with pytest.raises(SvbrdfError, match="unobserved"):
        result.apply(SPLIT, stroke=as_text(np.array([world(result, nowhere)] * 2)))
    assert contents(result.folder) == before
