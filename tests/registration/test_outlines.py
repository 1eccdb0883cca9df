"""The geometry's own lines: a camera found by them, and a film that they hold in place."""

from dataclasses import replace

import numpy as np
from analytic import orbit
from registration_scenes import Print, box, disturbed, draw, rms

from meshlab_svbrdf.registration.outlines import fit_outline, outline
from meshlab_svbrdf.registration.overlay import feature_edges
from meshlab_svbrdf.registration.pose import moved
from meshlab_svbrdf.registration.results import Options
from meshlab_svbrdf.registration.surface import Surface
from meshlab_svbrdf.registration.track import register_frames

BOX = box()
SURFACE = Surface(BOX.vertices, BOX.faces)
EDGES = feature_edges(SURFACE.vertices, SURFACE.faces)
CAMERAS = orbit(12, distance=4.5, turns=12 / 90, climb=50, width=320, height=240, fx=380.0)
PLAIN = Print(1, finest=12.0)


def test_lines_lie_where_they_are_seen():
    """In a frame that the true camera sees, its lines have their steps, to a part of a pixel."""
    camera = SURFACE.inner(CAMERAS[0])
    frame = draw(BOX, CAMERAS[0], PLAIN, noise=0.0)
    lines = outline(frame, SURFACE.view(camera, jumps=False), camera, SURFACE, EDGES)
    assert len(lines) > 0.8 * lines.looked
    assert np.median(lines.off(camera)) < 0.5
    # Along a line nothing is known
    np.testing.assert_allclose(np.linalg.det(lines.whitener), 0, atol=1e-12)
    np.testing.assert_allclose(np.trace(lines.whitener, axis1=1, axis2=2), 1)


def test_slopes_are_those_of_the_residuals():
    camera = SURFACE.inner(CAMERAS[3])
    frame = draw(BOX, CAMERAS[3], PLAIN)
    lines = outline(frame, SURFACE.view(camera, jumps=False), camera, SURFACE, EDGES)
    r, J = lines.linear(camera, True)
    step = 1e-6
    for k, axis in enumerate(np.eye(6)):
        there = lines.linear(moved(camera, step * axis), False)[0]
        np.testing.assert_allclose((r - there) / step, J[:, :, k], atol=2e-2)
    longer = replace(camera, fx=camera.fx * (1 + step), fy=camera.fy * (1 + step))
    np.testing.assert_allclose((r - lines.linear(longer, False)[0]) / step, J[:, :, 6], atol=2e-2)


def test_a_camera_is_drawn_to_the_frame_s_lines():
    frame = draw(BOX, CAMERAS[0], PLAIN, clutter=3)
    wrong = SURFACE.inner(disturbed(CAMERAS[0], 1.2, 0.01, 3))
    assert rms(CAMERAS[0], SURFACE.outer(wrong), BOX.vertices) > 1
    found, share = fit_outline(frame, wrong, SURFACE, EDGES, hold=4.0)
    assert rms(CAMERAS[0], SURFACE.outer(found), BOX.vertices) < 0.6
    elsewhere = SURFACE.inner(disturbed(CAMERAS[0], 12, 0.0, 5))
    assert share > fit_outline(frame, elsewhere, SURFACE, EDGES, hold=4.0)[1] + 0.2


def test_a_start_that_is_off_is_put_right():
    """Print may slide on a box's faces; its edges may not."""
    film = [draw(BOX, camera, Print(1), clutter=k) for k, camera in enumerate(CAMERAS)]
    wrong = disturbed(CAMERAS[0], 0.8, 0.015, 1)
    assert rms(CAMERAS[0], wrong, BOX.vertices) > 1.5
    options = Options(features=150, start_error=2.0)
    found = register_frames(BOX.vertices, BOX.faces, film, {0: wrong}, options)
    errors = [rms(c, found.cameras[k], BOX.vertices) for k, c in enumerate(CAMERAS)]
    assert max(errors) < 0.8
