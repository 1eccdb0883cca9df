"""A printed box, filmed and photographed: every camera against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import look_at, orbit
from registration_scenes import Print, box, disturbed, draw, rms

from meshlab_svbrdf.registration.refine import refine_cameras
from meshlab_svbrdf.registration.results import Options
from meshlab_svbrdf.registration.track import register_frames

BOX = box()
PRINT = Print(1)
SIZE = {"width": 320, "height": 240, "fx": 380.0}
CAMERAS = orbit(24, distance=4.5, turns=24 / 90, climb=50, **SIZE)  # 4° a frame
FAST = Options(features=150)


def errors(cameras, found):
    return np.array([rms(a, found[k], BOX.vertices) for k, a in enumerate(cameras) if k in found])


@pytest.fixture(scope="module")
def film():
    return [draw(BOX, camera, PRINT, clutter=k) for k, camera in enumerate(CAMERAS)]


def test_video_from_its_first_camera(film):
    """Before a wall that is another in every frame: nothing of it may be followed."""
    found = register_frames(BOX.vertices, BOX.faces, film, {0: CAMERAS[0]}, FAST)
    assert [f.status for f in found.frames] == ["registered"] * len(film)
    assert errors(CAMERAS, found.cameras).max() < 0.25
    assert min(f.confidence for f in found.frames) > 0.8
    assert all(f.residual < 0.5 and f.inliers > 50 for f in found.frames[1:])


def test_start_in_the_middle(film):
    found = register_frames(BOX.vertices, BOX.faces, film, {11: CAMERAS[11]}, FAST)
    assert len(found.cameras) == len(film)
    assert errors(CAMERAS, found.cameras).max() < 0.25


def test_the_world_may_lie_anywhere(film):
    """Turned, scaled and moved to map coordinates, the same cameras are found."""
    turn = look_at([1, 2, 3]).R
    move, scale = np.array([4.5e5, 5.4e6, 120.0]), 250.0
    vertices = scale * BOX.vertices @ turn.T + move

    def there(camera):
        R = camera.R @ turn.T
        return replace(camera, R=R, t=scale * camera.t - R @ move)

    some = film[:6]
    here = register_frames(BOX.vertices, BOX.faces, some, {0: CAMERAS[0]}, FAST)
    found = register_frames(vertices, BOX.faces, some, {0: there(CAMERAS[0])}, FAST)
    for k in range(len(some)):
        assert rms(there(here.cameras[k]), found.cameras[k], vertices) < 0.5


def test_exposure_and_highlights_do_not_drag_the_camera():
    gains = 1 + 0.3 * np.sin(np.arange(len(CAMERAS)))
    film = [
        draw(BOX, camera, PRINT, gain=gain, glint=0.6, clutter=3)
        for camera, gain in zip(CAMERAS, gains, strict=True)
    ]
    found = register_frames(BOX.vertices, BOX.faces, film, {0: CAMERAS[0]}, FAST)
    assert len(found.cameras) == len(film)
    assert errors(CAMERAS, found.cameras).max() < 0.4


def test_frames_that_show_nothing_are_bridged_and_named(film):
    broken = list(film)
    for k in (9, 10):
        broken[k] = np.full_like(film[k], 90)
    found = register_frames(BOX.vertices, BOX.faces, broken, {0: CAMERAS[0]}, FAST)
    assert [k for k, f in enumerate(found.frames) if f.status == "bridged"] == [9, 10]
    assert all(found.frames[k].reason and found.frames[k].confidence == 0 for k in (9, 10))
    assert errors(CAMERAS, found.cameras).max() < 2  # between its neighbours
    unbridged = register_frames(
        BOX.vertices, BOX.faces, broken[:12], {0: CAMERAS[0]}, replace(FAST, bridge=0)
    )
    assert [k for k, f in enumerate(unbridged.frames) if f.camera is None] == [9, 10]


def test_a_frame_of_another_size_is_named(film):
    frames = [*film[:3], film[3][:, :300]]
    found = register_frames(BOX.vertices, BOX.faces, frames, {0: CAMERAS[0]}, FAST)
    assert found.frames[3].status == "unregistered"
    assert "300×240" in found.frames[3].reason


def test_no_start_is_an_error(film):
    with pytest.raises(ValueError, match="at least one camera"):
        register_frames(BOX.vertices, BOX.faces, film, {})


def test_stills_in_any_order():
    """8° apart, shuffled; one shows another object and is named."""
    cameras = orbit(12, distance=4.5, turns=12 * 8 / 360, climb=50, **SIZE)
    cameras = [cameras[k] for k in np.random.default_rng(2).permutation(12)]
    frames = [draw(BOX, camera, PRINT, clutter=k) for k, camera in enumerate(cameras)]
    frames[4] = draw(BOX, cameras[4], Print(99), clutter=5)  # the last one around
    found = register_frames(
        BOX.vertices, BOX.faces, frames, {0: cameras[0]}, replace(FAST, ordered=False)
    )
    assert [k for k, f in enumerate(found.frames) if f.camera is None] == [4]
    assert found.frames[4].reason
    assert errors(cameras, found.cameras).max() < 0.4


def test_a_wrong_focal_length_is_found(film):
    wrong = replace(CAMERAS[0], fx=CAMERAS[0].fx * 1.02, fy=CAMERAS[0].fy * 1.02)
    options = replace(FAST, free_focal=True)
    found = register_frames(BOX.vertices, BOX.faces, film, {0: wrong}, options)
    assert abs(found.cameras[12].fx / CAMERAS[0].fx - 1) < 0.003
    assert errors(CAMERAS, found.cameras).max() < 0.8


def test_given_cameras_are_refined(film):
    given = {k: disturbed(c, 0.8, 0.004, k) for k, c in enumerate(CAMERAS)}
    assert errors(CAMERAS, given).max() > 1
    found = refine_cameras(BOX.vertices, BOX.faces, film, given, FAST)
    assert errors(CAMERAS, found.cameras).max() < 0.5
