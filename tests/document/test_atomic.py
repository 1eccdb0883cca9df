"""Files whole or not at all."""

import pytest

from meshlab_svbrdf.document.atomic import filling


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files_take_their_places_together(tmp_path):
    out = tmp_path / "a" / "b"
    with filling(out) as part:
        (part / "one").write_text("1")
        (part / "two").write_text("2")
        assert names(out) == [part.name]
    assert names(out) == ["one", "two"]
    with filling(out) as part:
        (part / "two").write_text("new")
    assert [(out / name).read_text() for name in names(out)] == ["1", "new"]


def test_what_breaks_leaves_nothing_of_its_own(tmp_path):
    out = tmp_path / "a" / "b"

    def breaks():
        with filling(out) as part:
            (part / "one").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        breaks()
    assert names(tmp_path) == []
    out.mkdir(parents=True)
    (out / "one").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        breaks()
    assert names(out) == ["one"]
    assert (out / "one").read_text() == "old"
