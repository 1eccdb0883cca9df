"""A phone's film of a box: what was made is what is told of it, and it registers from picks."""

import numpy as np
import pytest

from benchmarks.phone_film import BOX, Options, make_film
from benchmarks.registration import PHONE, REGISTER, _phone, tables
from meshlab_svbrdf.document.footage import ClipFrames, open_video
from meshlab_svbrdf.document.picked_points import read_points


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    return make_film(tmp_path_factory.mktemp("film"), Options(270, 480, 48, 40.0))


def test_the_container_turns_the_frames_upright_and_drops_some(film):
    clip = open_video(film.path)
    assert clip.size == (270, 480)
    np.testing.assert_allclose(clip.times, film.times, atol=1e-4)


def test_the_box_is_where_its_truth_says(film):
    """Just within the corners of its front every frame shows plain cardboard."""
    clip = open_video(film.path)
    corners = 0.93 * np.array([[x, y, 1 / 0.93] for x in (-1, 1) for y in (-1, 1)]) * BOX / 2
    with ClipFrames(clip) as frames:
        for k in range(0, len(clip), 8):
            col, row = np.rint(film.seen(k, corners)).astype(int).T
            shown = frames[k][row, col].astype(float)
            assert (shown[:, 0] > 1.15 * shown[:, 2]).all()
            assert np.ptp(shown[:, 1]) < 30


def test_a_pinhole_at_rest_sees_what_the_film_shows(film):
    """The picks lie where the truth sees them, but for what a hand misses."""
    (picked,) = read_points(film.picks)
    miss = picked.in_frame(270, 480) - film.seen(0, picked.world)
    assert 0.05 < np.sqrt((miss**2).sum(1).mean()) < 1.0


def test_it_registers_from_picked_points(film, tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.registration.make_film", lambda folder: film)
    told = {"focal": 1.0, "distortion": "0.03", "step": "3"}
    row = _phone(tmp_path, told, 0.0, tmp_path / "work")
    assert len(row["errors"]) == row["frames"] == -(-len(film.times) // 3)
    assert max(row["errors"]) < 1.5
    (table,) = tables([row | {"scene": "printed box", "name": f"{PHONE}: {REGISTER}"}])
    assert table.cells[0]
