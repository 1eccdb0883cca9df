"""Sheets: pictures stay as they are, under titles, beside scales."""

import numpy as np
import pytest

from meshlab_svbrdf.rendering.sheet import Panel, sheet


def holds(whole: np.ndarray, part: np.ndarray) -> bool:
    views = np.lib.stride_tricks.sliding_window_view(whole, part.shape)
    return bool((views == part).all((-3, -2, -1)).any())


@pytest.fixture
def images() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (30, w, 3), np.uint8) for w in (24, 40, 12)]


def test_every_picture_is_in_it_unchanged(images):
    a, b, c = (Panel(image, f"picture {k}") for k, image in enumerate(images))
    made = sheet([[a, b], [c]])
    assert made.dtype == np.uint8
    assert all(holds(made, image) for image in images)
    np.testing.assert_array_equal(made, sheet([[a, b], [c]]))
    assert (sheet([[a._replace(title="")]]) != sheet([[a]])[: a.image.shape[0] + 24]).any()


def test_a_scale_stands_beside_its_picture(images):
    ramp = np.repeat(np.arange(0, 256, 4, dtype=np.uint8)[:, None], 3, 1)
    made = sheet([[Panel(images[0], "error", (ramp, "0", "32"))]])
    assert made.shape[1] > images[0].shape[1] + 20
    bar = made[-34:-4, images[0].shape[1] + 6].astype(int).sum(1)
    assert (np.diff(bar) < 0).all()  # bright on top


def test_what_cannot_stand_in_a_row_is_refused(images):
    with pytest.raises(ValueError, match="one height"):
        sheet([[Panel(images[0], ""), Panel(images[1][:20], "")]])
    for none in ([], [[]]):
        with pytest.raises(ValueError, match="needs rows"):
            sheet(none)
