"""Picked points: our formats, MeshLab's list, and what is none of them."""

import json

import numpy as np
import pytest

from meshlab_svbrdf.document.picked_points import MESHLAB, read_points
from meshlab_svbrdf.errors import DocumentError

WORLD = np.arange(12.0).reshape(4, 3) / 7
PIXELS = np.array([[10.5, 20], [30, 40.25], [50, 60], [7, 8]])


def csv(separator=", ", head="# frame: walk_000010.jpg\n# x, y, z, column, row\n"):
    rows = np.hstack([WORLD, PIXELS]).tolist()
    return head + "\n".join(separator.join(map(repr, row)) for row in rows) + "\n"


@pytest.mark.parametrize("separator", [", ", " ", ";", "\t"])
def test_csv(tmp_path, separator):
    path = tmp_path / "points.csv"
    path.write_text(csv(separator) + "\n1 2 3 4 5  # the nose\n")
    (found,) = read_points(path)
    assert found.frame == "walk_000010.jpg"
    np.testing.assert_array_equal(found.world[:4], WORLD)
    np.testing.assert_array_equal(found.in_frame(100, 80)[:4], PIXELS)
    assert len(found.world) == 5


def test_csv_of_several_frames_and_of_none(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(csv(head="") + csv(head="# frame: b.jpg\n"))
    assert [(p.frame, len(p.world)) for p in read_points(path)] == [("", 4), ("b.jpg", 4)]


def test_json(tmp_path):
    path = tmp_path / "points.json"
    points = [
        {"world": w.tolist(), "pixel": p.tolist()} for w, p in zip(WORLD, PIXELS, strict=True)
    ]
    for content in (
        {"frames": [{"frame": "a.jpg", "points": points}]},
        {"frame": "a.jpg", "points": points},
    ):
        path.write_text(json.dumps(content))
        (found,) = read_points(path)
        assert found.frame == "a.jpg"
        np.testing.assert_array_equal(found.world, WORLD)
        np.testing.assert_array_equal(found.in_frame(100, 80), PIXELS)


def test_meshlabs_list_counts_rows_upwards(tmp_path):
    """The bottom row is MeshLab's 0, and ours is the height less one."""
    path = tmp_path / "corrs.txt"
    path.write_text(
        "-------RASTER ALIGNMENT DATA---------\n3D Model: bust.ply\n"
        "Raster: C:/walks/first film/f 000.jpg\nCorr PP0 0.5 1e-3 -2 100 0\n"
        "Corr PP1 1 2 3 0 479\n\n"
    )
    (found,) = read_points(path)
    assert found.frame == "f 000.jpg"
    np.testing.assert_array_equal(found.world, [[0.5, 1e-3, -2], [1, 2, 3]])
    np.testing.assert_array_equal(found.in_frame(640, 480), [[100, 479], [0, 0]])


def test_points_outside_of_the_frame_are_named(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(csv())
    with pytest.raises(DocumentError, match=r"column 30, row 40\.25 is outside.*32×40 pixels"):
        read_points(path)[0].in_frame(32, 40)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("p.csv", "1,2,3,4\n", "line 1: expected x, y, z, column, row"),
        ("p.csv", "# head\n1,2,3,4,five\n", "line 2"),
        ("p.csv", "1,2,3,4,nan\n", "line 1"),
        ("p.csv", "# nothing\n", "holds no points"),
        ("p.json", "{}", "expected"),
        ("p.json", "[1", "expected"),
        ("p.json", '{"points": [{"world": [1, 2], "pixel": [1, 2, 3]}]}', "point 0"),
        ("p.json", '{"frames": [{"frame": "a", "points": []}]}', "holds no points"),
        ("p.txt", MESHLAB + "---------\nCorr PP0 1 2 3 4\n", "line 2: expected Corr"),
        ("p.txt", MESHLAB + "---------\n", "holds no points"),
    ],
)  # fmt: skip
def test_damaged_files_are_named(tmp_path, name, text, says):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(DocumentError, match=says) as error:
        read_points(path)
    assert str(path) in str(error.value)


def test_missing_and_binary_files_are_named(tmp_path):
    with pytest.raises(DocumentError, match="cannot be read"):
        read_points(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(DocumentError, match="cannot be read as text"):
        read_points(tmp_path / "b.csv")
