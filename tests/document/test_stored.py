"""Stored values: what comes back, and damage that is named."""

import json

import numpy as np
import pytest

from meshlab_svbrdf.document.stored import read_array, read_json
from meshlab_svbrdf.errors import DocumentError


@pytest.mark.parametrize("text", ["", "{", '{"a": 1,}', "[" * 100_000, '"\x00"', "\udcff"])
def test_what_is_no_json_is_named(tmp_path, text):
    (tmp_path / "a.json").write_text(text, errors="surrogateescape")
    with pytest.raises(DocumentError, match=r"a\.json: is no JSON"):
        read_json(tmp_path / "a.json")


def test_json_comes_back_and_a_missing_file_is_named(tmp_path):
    (tmp_path / "ä b.json").write_text(json.dumps({"ä": [1, None]}), encoding="utf-8")
    assert read_json(tmp_path / "ä b.json") == {"ä": [1, None]}
    with pytest.raises(DocumentError, match=r"c\.json: cannot be read"):
        read_json(tmp_path / "c.json")


@pytest.mark.parametrize("mmap", [False, True])
def test_an_array_that_is_cut_off_anywhere_is_named(tmp_path, mmap):
    path = tmp_path / "a.npy"
    np.save(path, np.arange(7.0))
    data = path.read_bytes()
    np.testing.assert_array_equal(read_array(path, mmap=mmap), np.arange(7.0))
    for length in range(0, len(data), 3):
        path.write_bytes(data[:length])
        with pytest.raises(DocumentError, match=r"a\.npy"):
            read_array(path, mmap=mmap)


def test_arrays_of_objects_are_never_made(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}], object), allow_pickle=True)
    with pytest.raises(DocumentError, match=r"a\.npy"):
        read_array(tmp_path / "a.npy")
