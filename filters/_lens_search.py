"""The distortion of a lens, estimated: k1 is that under which frames register best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from meshlab_svbrdf.document.footage import Clip, ClipFrames
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace
from meshlab_svbrdf.geometry.lens import Lens, with_coefficients
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.results import Options, Registration
from meshlab_svbrdf.registration.track import register_frames

from ._clips import centred_lens, focal_length
from ._starts import Start, solve_start

TRIED = 24  # frames around the start
MOST = 0.12  # share of its distance that the farthest corner may be moved by
GRID = 5
NARROWED = 8  # trials between two of the grid
MISSING = 3.0  # pixels: what a frame without a camera costs


def estimate_lens(
    mesh: Mesh, clip: Clip, starts: list[Start], options: Options, parameters: Namespace,
    progress: Progress,
) -> Lens | None:  # fmt: skip
    """The lens whose undistorted frames agree best with the mesh; None where it does not distort.

    Some frames on each side of a start are registered with one k1 after the other.

    Raises SvbrdfError where the focal length is not known: both cannot be found at once.
    """
    filmed = next((start.filmed for start in starts if start.filmed is not None), None)
    focal = focal_length(clip, parameters)
    if filmed is None and focal is None:
        raise SvbrdfError(
            "distortion=auto needs the focal length: give focal, in pixels, or focal_mm"
        )
    start = starts[0]
    at = start.place.frame
    low = max(0, min(at - TRIED // 2, len(clip) - TRIED))
    part = clip.only(range(low, min(len(clip), low + TRIED)))
    local = replace(start, place=replace(start.place, frame=at - low), rough=False)
    done = 0

    def lens(k1: float) -> Lens:
        if filmed is not None and not (parameters.focal or parameters.focal_mm):
            return with_coefficients(filmed, [k1])
        assert focal is not None
        return centred_lens(clip, focal, (k1, 0.0, 0.0, 0.0, 0.0))

    def cost(k1: float) -> float:
        nonlocal done
        done += 1
        progress(done / (GRID + NARROWED), f"k1 {k1:+.3f}")
        try:
            made = lens(k1)
            made.pinhole()
        except (SvbrdfError, ValueError):
            return MISSING
        with ClipFrames(part, [made] * len(part)) as frames:
            camera, _, _ = solve_start(
                mesh, part, local, made, frames, at - low, parameters
            )  # fmt: skip
            quick = replace(options, free_focal=False, cut=0.0)
            result = register_frames(mesh.vertices, mesh.faces, frames, {at - low: camera}, quick)
        return _misfit(result) * made.fx / made.pinhole().fx  # in pixels as they were filmed

    # Look where the least cost is, then narrow it down
    plain = lens(0.0)
    corner = np.hypot(clip.size[0] / 2, clip.size[1] / 2) / plain.fx
    grid = np.linspace(-MOST, MOST, GRID) / corner**2
    costs = [cost(k1) for k1 in grid]
    best = int(np.argmin(costs))
    if not costs[best] < MISSING:
        return None
    bounds = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
    found = minimize_scalar(
        cost,
        bounds=bounds,
        method="bounded",
        options={"maxiter": NARROWED, "xatol": 1e-3 / corner**2},
    )
    k1 = float(found.x) if found.fun < costs[best] else float(grid[best])
    return lens(k1)


def _misfit(result: Registration) -> float:
    """Mean residual of the frames, in pixels."""
    residuals = [
        min(frame.residual, MISSING) if frame.camera is not None and frame.inliers else MISSING
        for frame in result.frames
    ]
    return float(np.mean(residuals))
