"""Scale and pose of cameras from elsewhere as a whole: how they are brought to the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.project import RasterEntry
from meshlab_svbrdf.document.reconstruction import Reconstruction, read_text
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.registration.similarity import (
    Similarity,
    similarity_of_points,
    similarity_to_mesh,
)

LEAST_CAMERAS = 3
WELL_LAID = 0.02  # of the mesh's radius: sparse points that stay farther off are not its own


def align(
    reconstruction: Reconstruction, how: str, pairs: Path | None, rasters: Sequence[RasterEntry],
    mesh: Mesh,
) -> tuple[Similarity, str]:  # fmt: skip
    """The similarity from the reconstruction's world to the mesh's, and what is said of it.

    how : none, pairs, rasters, points, or auto: the first of pairs, rasters and points that there
        are data for

    Raises SvbrdfError where the data do not determine it.
    """
    centers = _shared(reconstruction, rasters)
    if how == "auto":
        how = (
            "pairs" if pairs is not None else "rasters" if len(centers[0]) >= LEAST_CAMERAS
            else "points"
        )  # fmt: skip
        if how == "points" and not len(reconstruction.points):
            raise SvbrdfError(
                f"{reconstruction.path}: nothing tells how its world lies to the mesh's: give "
                "pairs=FILE of at least three points in both, align three of its frames as "
                "rasters, or say align=none where both worlds are one"
            )
    if how == "none":
        return Similarity(1.0, np.eye(3), np.zeros(3)), "cameras as they are"
    try:
        if how == "pairs":
            if pairs is None:
                raise SvbrdfError("align=pairs needs pairs=FILE")
            source, target = read_pairs(pairs)
            found = similarity_of_points(source, target)
            return found, _said(found, source, target, f"{len(source)} pairs of points", mesh)
        if how == "rasters":
            source, target = centers
            found = similarity_of_points(source, target)
            return found, _said(found, source, target, f"{len(source)} aligned rasters", mesh)
        found, rms = similarity_to_mesh(reconstruction.points, mesh.vertices)
    except ValueError as error:
        raise SvbrdfError(f"align={how}: {error}") from None
    share = rms / mesh.radius
    if share > WELL_LAID:
        raise SvbrdfError(
            f"{reconstruction.path}: its points do not lie on the mesh ({100 * share:.1f} % of the "
            "mesh's radius off): give pairs=FILE of at least three points in both worlds"
        )
    return found, f"its points on the mesh, {100 * share:.2f} % of the radius off"


def read_pairs(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) in the cameras' world and the same in the mesh's: x y z X Y Z a line."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
            if len(row) != 6 or not np.isfinite(row).all():
                raise ValueError
        except ValueError:
            raise SvbrdfError(
                f"{path}, line {number}: expected x, y, z in the cameras' world and X, Y, Z on the "
                f"mesh, found {line.strip()!r}"
            ) from None
        rows.append(row)
    values = np.array(rows).reshape(-1, 6)
    return values[:, :3], values[:, 3:]


def _shared(
    reconstruction: Reconstruction, rasters: Sequence[RasterEntry]
) -> tuple[np.ndarray, np.ndarray]:
    """Where cameras of the same image stand in both worlds."""
    known = {raster.path.stem: raster.camera.center for raster in rasters}
    both = [
        (-each.R.T @ each.t, known[Path(each.name).stem])
        for each in reconstruction.cameras
        if Path(each.name).stem in known
    ]
    values = np.array(both).reshape(-1, 2, 3)
    return values[:, 0], values[:, 1]


def _said(found: Similarity, source: np.ndarray, target: np.ndarray, what: str, mesh: Mesh) -> str:
    off = np.linalg.norm(found.points(source) - target, axis=1)
    rms = float(np.sqrt(np.mean(off**2)))
    if len(source) > 3 and rms > 0.2 * mesh.radius:
        worst = int(off.argmax()) + 1
        raise SvbrdfError(
            f"{what} do not agree: {100 * rms / mesh.radius:.0f} % of the mesh's radius off, the "
            f"{worst}th most; see to their order"
        )
    return f"{what}, {100 * rms / mesh.radius:.2f} % of the radius off"
