"""Motions against their definition, fits against the truth, picks against a known camera."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import look_at
from registration_scenes import Print, box, disturbed, draw, rms

from meshlab_svbrdf.registration.contrast import blur_effect, normalise
from meshlab_svbrdf.registration.points import solve_camera_from_points
from meshlab_svbrdf.registration.pose import (
    fit_camera,
    moved,
    pixel_motion,
    point_motion,
    predicted,
    twist_between,
)
from meshlab_svbrdf.registration.refine import refine_camera
from meshlab_svbrdf.registration.surface import Surface
from meshlab_svbrdf.registration.warp import warp

CAMERA = look_at([1.0, 0.6, 3.0], width=320, height=240, fx=400.0)
POINTS = np.random.default_rng(0).uniform(-0.7, 0.7, (60, 3))


def test_twist_is_the_inverse_of_the_motion():
    twist = np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.2])
    np.testing.assert_allclose(twist_between(CAMERA, moved(CAMERA, twist)), twist, atol=1e-12)


def test_prediction_goes_on():
    """A camera that turns about the object by the same angle each time is predicted exactly."""
    steps = [disturbed(CAMERA, 3.0 * k, 0, 4) for k in range(3)]
    found = predicted(steps[0], steps[1])
    assert rms(steps[2], found, POINTS) < 1e-9


def test_slopes_agree_with_differences():
    local = POINTS @ CAMERA.R.T + CAMERA.t
    J = pixel_motion(local, CAMERA) @ point_motion(local)
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        ahead, back = (moved(CAMERA, s).project(POINTS)[:, :2] for s in (step, -step))
        np.testing.assert_allclose(J[..., axis], (ahead - back) / 2e-6, rtol=1e-5, atol=1e-4)


def test_fit_finds_the_camera_among_outliers():
    rng = np.random.default_rng(1)
    found = CAMERA.project(POINTS)[:, :2] + 0.1 * rng.normal(size=(60, 2))
    found[:20] += rng.uniform(-40, 40, (20, 2))
    whitener = np.tile(np.eye(2) / 0.1, (60, 1, 1))
    fit = fit_camera(POINTS, found, whitener, disturbed(CAMERA, 1.5, 0.02, 3))
    assert rms(CAMERA, fit.camera, POINTS) < 0.15
    assert not fit.inlier[:20][
        np.linalg.norm(found - CAMERA.project(POINTS)[:, :2], axis=1)[:20] > 2
    ].any()
    assert 0.5 < rms(CAMERA, fit.camera, POINTS) / fit.uncertainty(POINTS) < 2


def test_fit_does_not_look_along_edges():
    """Wrong by pixels in the directions that are unknown, exact in the others."""
    angle = np.random.default_rng(2).uniform(0, np.pi, 60)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    found = CAMERA.project(POINTS)[:, :2] + 5 * np.sin(7 * angle)[:, None] * along
    whitener = np.einsum("ni,nj->nij", across, across) / 0.1
    fit = fit_camera(POINTS, found, whitener, disturbed(CAMERA, 0.5, 0.01, 3))
    assert rms(CAMERA, fit.camera, POINTS) < 1e-3


def test_fit_says_when_nothing_holds_the_camera():
    few = np.tile(np.eye(2), (3, 1, 1))
    assert fit_camera(POINTS[:3], CAMERA.project(POINTS[:3])[:, :2], few, CAMERA) is None


@pytest.mark.parametrize("count", [4, 6, 20])
def test_camera_from_points(count):
    points = POINTS[:count] + np.array([1e5, 0, 0])
    true = CAMERA.about(np.array([-1e5, 0.0, 0.0]))
    found = solve_camera_from_points(points, true.project(points)[:, :2], (320, 240), 400.0)
    assert rms(true, found, points) < 1e-3


@pytest.mark.parametrize("plane", [False, True])
def test_focal_length_from_points(plane):
    points = POINTS[:12] * ([1, 1, 0] if plane else [1, 1, 1])
    camera = look_at([2.0, 1.2, 2.0], width=320, height=240, fx=310.0)
    found = solve_camera_from_points(points, camera.project(points)[:, :2], (320, 240))
    assert found.fx == pytest.approx(310.0, rel=1e-3)


def test_points_that_tell_nothing_are_refused():
    line = np.outer(np.arange(5.0), [1, 2, 3])
    with pytest.raises(ValueError, match="on one line"):
        solve_camera_from_points(line, np.zeros((5, 2)), (320, 240), 400.0)
    with pytest.raises(ValueError, match="at least 4"):
        solve_camera_from_points(POINTS[:3], np.zeros((3, 2)), (320, 240), 400.0)


def test_keyframe_carried_over_is_the_other_view():
    """The surface carries one view's pixels to where the other camera has drawn them."""
    mesh, print_ = box(), Print(3, finest=25.0)
    surface = Surface(mesh.vertices, mesh.faces)
    other = disturbed(CAMERA, 12, 0.05, 1)
    a, b = (surface.view(surface.inner(c)) for c in (CAMERA, other))
    frames = [draw(mesh, c, print_, noise=0.0) for c in (CAMERA, other)]
    out, valid = warp(np.ascontiguousarray(a.crop(frames[0])), a, b, 0.02)
    clear = (valid > 0) & (b.inside > 3)
    assert clear.sum() > 5000
    assert np.abs(out - b.crop(frames[1]))[clear].mean() < 2


def test_surface_does_not_care_for_winding_or_units():
    mesh = box()
    inside_out = Surface(1e3 * mesh.vertices + 7, mesh.faces[:, ::-1])
    plain = Surface(mesh.vertices, mesh.faces)
    camera = replace(CAMERA, t=1e3 * CAMERA.t).about(np.full(3, -7.0))
    a, b = plain.view(plain.inner(CAMERA)), inside_out.view(inside_out.inner(camera))
    np.testing.assert_allclose(a.inverse_depth, b.inverse_depth, rtol=1e-5)


def test_contrast_is_free_of_exposure():
    image = draw(box(), CAMERA, Print(1), noise=0.0)
    everywhere = np.ones_like(image)
    darker = (image * 0.6 + 20).astype(np.uint8)
    a, b = (normalise(x, everywhere).astype(int) for x in (image, darker))
    assert np.abs(a - b).mean() < 4


def test_blur_grows_with_blur():
    import cv2

    image = draw(box(), CAMERA, Print(1), clutter=1)
    values = [blur_effect(image)]
    values += [blur_effect(cv2.GaussianBlur(image, (0, 0), s)) for s in (1.0, 2.0, 4.0)]
    assert values == sorted(values)
    assert 0 < values[0] < values[-1] <= 1


def test_mutual_information_finds_the_camera_of_one_frame():
    """Turned by 5° and 5 % too far, before a wall. And it says when there is no object."""
    mesh = box((0.9, 0.6, 0.45))
    camera = look_at([1.6, 1.2, 3.2], width=160, height=120, fx=180.0)
    frame = draw(mesh, camera, lambda points: np.full(len(points), 0.7), clutter=2)
    wrong = disturbed(camera, 5.0, 0.05, 8)
    assert rms(camera, wrong, mesh.vertices) > 2
    found = refine_camera(mesh.vertices, mesh.faces, frame, wrong)
    assert found.converged
    assert rms(camera, found.camera, mesh.vertices) < 1
    wall = np.random.default_rng(0).integers(0, 255, frame.shape, np.uint8)
    assert not refine_camera(mesh.vertices, mesh.faces, wall, wrong).converged
