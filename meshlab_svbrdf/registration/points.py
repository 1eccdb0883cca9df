"""A camera from points picked on the mesh and in the frame."""

from __future__ import annotations

import numpy as np

from ..geometry.camera import Camera


def solve_camera_from_points(
    points3d: np.ndarray,
    points2d: np.ndarray,
    size: tuple[int, int],
    focal: float | None = None,
) -> Camera:
    """The camera that sees points of the world where they were picked.

    Parameters
    ----------
    points3d : (n, 3) float64, world; n ≥ 4
    points2d : (n, 2) float64, column and row in pixels, centres at whole numbers
    size : width, height of the frame
    focal : pixels; None: estimated, which needs n ≥ 5 points that are not all in one plane, or ≥ 4
        in a plane that is seen at a slant

    Returns
    -------
    camera : principal point at the frame's centre, square pixels

    Raises
    ------
    ValueError : too few points, or no camera sees them so.
    """
    raise NotImplementedError
