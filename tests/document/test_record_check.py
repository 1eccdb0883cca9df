"""A record of results that somebody else wrote: nothing outside of the folder is touched."""

import copy
import json
import os

import pytest

from meshlab_svbrdf.document.record import RECORD, ResultFolder, empty_record
from meshlab_svbrdf.document.record_check import check_record
from meshlab_svbrdf.errors import DocumentError

MATRIX = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
GOOD = empty_record() | {
    "settings": {"object": "stone", "held_out": ["f3"], "shown": {"layers/object.ply": "ab"}},
    "products": {
        "texels": {"filter": "f", "key": "k", "inputs": {"mesh": "m"}, "layers": {},
                   "files": ["arrays/texels_face.npy", "samples/"]},
        "shade": {"filter": "g", "key": "l", "inputs": {"texels": "k"}, "files": ["a b/ä.npy"],
                  "layers": {"map: x": {"map": "x"}, "e": {"file": "layers/e.ply", "visible": True,
                                                           "matrix": MATRIX}}},
    },
    "runs": {"f": {"parameters": {}}},
}  # fmt: skip


def test_a_good_record_is_taken():
    check_record(GOOD)


@pytest.mark.parametrize(
    "entry",
    ["../mine.txt", "maps/../../mine.txt", "/etc/passwd", "", ".", "..\\mine.txt", "C:\\a", "//a/b",
     "a\0b"],
)  # fmt: skip
@pytest.mark.parametrize("place", ["files", "shown", "file", "map"])
def test_entries_that_leave_the_folder_are_refused(entry, place):
    record = copy.deepcopy(GOOD)
    shade = record["products"]["shade"]
    if place == "files":
        shade["files"].append(entry)
    elif place == "shown":
        record["settings"]["shown"][entry] = ""
    else:
        shade["layers"]["e"] = GOOD["products"]["shade"]["layers"]["e"] | {"file": entry}
        if place == "map":
            shade["layers"]["e"] = {"map": entry}
    with pytest.raises(ValueError, match="does not lie in the folder"):
        check_record(record)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["settings"], None), (["products"], []), (["runs"], 3), (["settings", "held_out"], "f3"),
        (["products", "shade"], "none"), (["products", "shade", "files"], {"a": 1}),
        (["products", "shade", "files"], [None]), (["products", "shade", "inputs"], ["texels"]),
        (["products", "shade", "inputs", "texels"], 5), (["products", "shade", "layers", "e"], 1),
        (["products", "shade", "layers", "e", "matrix"], [1, 2]), (["runs", "f"], []),
        (["products", "texels", "inputs", "shade"], "l"),
    ],
)  # fmt: skip
def test_what_is_no_record_is_named_with_its_place(tmp_path, path, value):
    record = copy.deepcopy(GOOD)
    part = record
    for name in path[:-1]:
        part = part[name]
    part[path[-1]] = value
    (tmp_path / "r.svbrdf").mkdir()
    (tmp_path / "r.svbrdf" / RECORD).write_text(json.dumps(record))
    with pytest.raises(DocumentError, match=r"svbrdf\.json is not a record.*move r\.svbrdf away"):
        ResultFolder(tmp_path / "r.svbrdf")


def test_a_commit_that_somebody_planted_removes_nothing_elsewhere(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    folder = tmp_path / "r.svbrdf"
    (folder / ".commit").mkdir(parents=True)
    old = copy.deepcopy(GOOD)
    old["products"]["texels"]["files"].append("../mine.txt")
    (folder / RECORD).write_text(json.dumps(old))
    (folder / ".commit" / RECORD).write_text(json.dumps(GOOD))
    with pytest.raises(DocumentError, match="does not lie"):
        ResultFolder(folder)
    assert (tmp_path / "mine.txt").read_text() == "mine"


@pytest.mark.parametrize("link", ["maps", "maps/a.png", ".staging"])
def test_links_that_leave_the_folder_are_refused(tmp_path, link):
    (tmp_path / "mine").mkdir()
    path = tmp_path / "r.svbrdf" / link
    path.parent.mkdir(parents=True)
    os.symlink(tmp_path / "mine", path)
    with pytest.raises(DocumentError, match=r"is a link to .*outside of the results"):
        ResultFolder(tmp_path / "r.svbrdf")
    assert not list((tmp_path / "mine").iterdir())


def test_the_folder_itself_may_be_a_link_to_another_disk(tmp_path):
    (tmp_path / "disk").mkdir()
    os.symlink(tmp_path / "disk", tmp_path / "r.svbrdf")
    assert ResultFolder(tmp_path / "r.svbrdf").record == empty_record()


@pytest.mark.parametrize("number", ["1e999", "-1e999", "NaN", "Infinity"])
def test_numbers_that_could_not_be_written_again_are_refused(tmp_path, number):
    path = tmp_path / "r.svbrdf" / "svbrdf.json"
    path.parent.mkdir()
    runs = f'{{"f": {{"parameters": {{}}, "seconds": {number}}}}}'
    path.write_text(f'{{"format": 1, "settings": {{}}, "products": {{}}, "runs": {runs}}}')
    with pytest.raises(DocumentError, match=f"{number} is no finite number"):
        ResultFolder(path.parent)
    path.write_text(path.read_text().replace(number, "1e9"))
    assert ResultFolder(path.parent).record["runs"]["f"]["seconds"] == 1e9
