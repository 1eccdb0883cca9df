"""Whether a mesh's texture coordinates can carry maps: one place on the surface for each texel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..blocks import blocks, room
from ..errors import SvbrdfError
from ..jit import kernel
from .mesh import Mesh

# Vertices are snapped to 1/1024 texel, so that the test of a pixel centre is exact in integers.
SUBTEXEL = 1024

# Charts of real scans touch here and there; more than this share of texels is a mistake.
TOLERATED_OVERLAP = 0.005

# Charts are torn when many edges are seams and much of the surface is drawn out of shape. Of scans:
# .12 and .06 at most, still .2 of shape; simplified without regard to charts .24 and .41 at least.
TORN_SEAMS, TORN_SHAPE = 0.2, 0.3
OUT_OF_SHAPE = 2.0  # stretched by this factor more in one direction than in the other

# A face is starved when its surface has less than this part of the texels that are usual.
STARVED = 1 / 16
TOLERATED_STARVED = 0.01


@dataclass(frozen=True)
class UvReport:
    """What is unusual about some texture coordinates.

    overlap_share : of the texels covered, those that belong to several places of the surface
    covered_share : of all texels of all textures, those covered
    out_of_range_faces : reach over the image's border by half a texel or more (tiled textures do)
    tiled_faces : of these, those that lie wholly outside it
    zero_area_faces : have no area in the texture, or coordinates that are not finite; no texels
    flipped_faces : mirrored (clockwise); harmless, even in tangent-space normal maps
    missing_texture_faces : name a texture that there is not
    seam_share : of the length of the edges between two faces, those where charts end
    skewed_share : of the surface's area, faces whose shape in the texture is not theirs in space
    starved_share : of the surface's area, faces with next to no texels for their size
    """

    faces: int
    overlap_share: float
    covered_share: float
    out_of_range_faces: int
    tiled_faces: int
    zero_area_faces: int
    flipped_faces: int
    missing_texture_faces: int
    seam_share: float
    skewed_share: float
    starved_share: float

    @property
    def torn(self) -> bool:
        """Whether the charts are in pieces that no longer fit the surface."""
        return self.seam_share > TORN_SEAMS and self.skewed_share > TORN_SHAPE

    @property
    def ok(self) -> bool:
        """Whether maps on these coordinates mean what they show."""
        return (
            self.overlap_share <= TOLERATED_OVERLAP
            and self.out_of_range_faces == 0
            and self.missing_texture_faces == 0
            and self.zero_area_faces < self.faces
            and self.starved_share <= TOLERATED_STARVED
            and not self.torn
        )

    @property
    def message(self) -> str:
        """What a user should know and do, in sentences; empty where all is well."""
        said = []
        if self.overlap_share > 0:
            said.append(
                f"{100 * self.overlap_share:.2g} % of the texels belong to several places of the "
                "surface"
            )
        if self.out_of_range_faces:
            said.append(
                f"{self.out_of_range_faces} of {self.faces} faces reach outside the texture "
                f"({self.tiled_faces} of them wholly, as with tiled textures) and lose those texels"
            )
        if self.missing_texture_faces:
            said.append(f"{self.missing_texture_faces} faces name a texture that the layer lacks")
        if self.zero_area_faces:
            said.append(
                f"{self.zero_area_faces} of {self.faces} faces have no area in the texture and "
                "get no texels"
            )
        if self.torn:
            said.append(
                f"The charts are torn, as by simplification without regard to the texture: "
                f"{100 * self.seam_share:.0f} % of the edges are seams, "
                f"{100 * self.skewed_share:.0f} % of the surface is out of shape, and "
                f"{100 - 100 * self.covered_share:.0f} % of the texture is empty"
            )
        if self.starved_share > TOLERATED_STARVED:
            said.append(f"{100 * self.starved_share:.2g} % of the surface has next to no texels")
        if not self.ok:
            said.append("Parametrise the mesh anew to give each place its own texels")
        return "".join(sentence + ". " for sentence in said).strip()


def check_uv(mesh: Mesh, sizes: tuple[tuple[int, int], ...]) -> UvReport:
    """Rasterise the charts and count what covers each texel.

    A pixel centre on an edge belongs to one of the two faces (top-left rule), so faces that share
    an edge do not overlap, and those that lie on each other do.

    Parameters
    ----------
    mesh : with `uv`; SvbrdfError without
    sizes : (height, width) of each texture
    """
    if mesh.uv is None:
        raise SvbrdfError("the mesh has no texture coordinates: parametrise it first")
    count = len(mesh.faces)
    texture = np.zeros(count, np.int32) if mesh.texture_index is None else mesh.texture_index
    finite = np.isfinite(mesh.uv).all(axis=(1, 2))
    zero_area = ~finite
    out_of_range, tiled, flipped = (np.zeros(count, dtype=bool) for _ in range(3))
    covered = repeated = 0
    for index, (height, width) in enumerate(sizes):
        here = np.flatnonzero((texture == index) & finite)
        counter = np.zeros((height, width), np.uint16)
        limit = np.array([width, height])
        for block in blocks(len(here)):
            own = here[block]
            pixels = np.stack(
                [mesh.uv[own, :, 0] * width - 0.5, (1 - mesh.uv[own, :, 1]) * height - 0.5], -1
            )
            outside = (pixels <= -1) | (pixels >= limit)
            out_of_range[own] = outside.any(axis=(1, 2))
            low, high = pixels.min(axis=1), pixels.max(axis=1)
            tiled[own] = ((high < -0.5) | (low > limit - 0.5)).any(axis=1)

            # Snap to the grid; what lies a texture or more outside comes no nearer by being cut off
            snapped = np.rint(np.clip(pixels, -(2**20), 2**20) * SUBTEXEL).astype(np.int64)
            area = _count(snapped, counter)
            zero_area[own] = area == 0
            flipped[own] = area > 0
        covered += int(np.count_nonzero(counter))
        repeated += int(np.count_nonzero(counter > 1))
    return UvReport(
        faces=count,
        overlap_share=repeated / covered if covered else 0.0,
        covered_share=covered / max(1, sum(h * w for h, w in sizes)),
        out_of_range_faces=int(out_of_range.sum()),
        tiled_faces=int(tiled.sum()),
        zero_area_faces=int(zero_area.sum()),
        flipped_faces=int(flipped.sum()),
        missing_texture_faces=int(np.count_nonzero((texture < 0) | (texture >= len(sizes)))),
        seam_share=_seam_share(mesh, texture),
        skewed_share=_skewed_share(mesh),
        starved_share=_starved_share(mesh, texture, sizes, zero_area),
    )


def _seam_share(mesh: Mesh, texture: np.ndarray) -> float:
    """Of the length of the edges between two faces, those with other coordinates on each side."""
    assert mesh.uv is not None
    faces, uv, count = mesh.faces, mesh.uv.reshape(-1, 2), len(mesh.faces)
    edge = room(3 * count, np.int64)
    for own in blocks(count):
        for k in range(3):
            low, high = np.sort(faces[own][:, [k, (k + 1) % 3]].astype(np.int64), axis=1).T
            edge[k * count + own.start : k * count + own.stop] = low * len(mesh.vertices) + high
    order = np.argsort(edge, kind="stable")

    def ends(side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The corners of some faces' sides (n, 2), by rising vertex, and their vertices."""
        face = side % count
        corner = np.stack([(side // count + k) % 3 + 3 * face for k in range(2)], 1)
        vertex = faces.reshape(-1)[corner]
        turned = vertex[:, 0] > vertex[:, 1]
        corner[turned], vertex[turned] = corner[turned, ::-1], vertex[turned, ::-1]
        return corner, vertex

    apart = total = 0.0
    for own in blocks(len(order) - 1):
        first, second = order[own], order[own.start + 1 : own.stop + 1]
        shared = edge[first] == edge[second]
        first, second = first[shared], second[shared]
        (a, vertex), (b, _) = ends(first), ends(second)
        length = np.linalg.norm(np.diff(mesh.vertices[vertex], axis=1)[:, 0], axis=1)
        seam = (np.abs(uv[a] - uv[b]) > 1e-5).any(axis=(1, 2))
        seam |= texture[first % count] != texture[second % count]
        apart, total = apart + length[seam].sum(), total + length.sum()
    return float(apart / total) if total else 0.0


def _skewed_share(mesh: Mesh) -> float:
    """Of the area, faces whose map to the texture stretches one direction OUT_OF_SHAPE times."""
    assert mesh.uv is not None
    skewed = total = 0.0
    for own in blocks(len(mesh.faces)):
        twice, out_of_shape = _shape(mesh.vertices[mesh.faces[own]], mesh.uv[own])
        skewed, total = skewed + twice[out_of_shape].sum(), total + twice.sum()
    return float(skewed / total) if total else 0.0


def _shape(corners: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Twice the area of faces (F,), and which of them are out of shape, (F,) bool.

    corners : (F, 3, 3); uv : (F, 3, 2)
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    along, side = b - a, c - a
    length = np.linalg.norm(along, axis=1)
    twice = np.linalg.norm(np.cross(along, side), axis=1)
    twice[np.isnan(twice)] = 0
    good = (twice > 0) & np.isfinite(uv).all(axis=(1, 2))

    # The map's columns in a frame of the face: along its first edge, and across it
    u, v = uv[good, 1] - uv[good, 0], uv[good, 2] - uv[good, 0]
    length, area = length[good, None], twice[good]
    first = u / length
    foot = (along[good] * side[good]).sum(1, keepdims=True) / length
    second = (v - first * foot) / (area[:, None] / length)
    # Stretches p ≥ q: p > n q exactly where p² + q² > (n + 1/n) p q
    squares = (first**2 + second**2).sum(1)
    product = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    skewed = np.zeros(len(uv), bool)
    skewed[good] = squares > (OUT_OF_SHAPE + 1 / OUT_OF_SHAPE) * product
    return twice, skewed


def _starved_share(
    mesh: Mesh, texture: np.ndarray, sizes: tuple[tuple[int, int], ...], lost: np.ndarray
) -> float:
    """Of the area, faces with less than STARVED of the density that the median texel has."""
    assert mesh.uv is not None
    area, texels = (room(len(mesh.faces), np.float64) for _ in range(2))
    pixels = np.array([0.0, *(h * w for h, w in sizes)])[np.clip(texture + 1, 0, len(sizes))]
    for own in blocks(len(area)):
        a, b, c = np.moveaxis(mesh.vertices[mesh.faces[own]], 1, 0)
        area[own] = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        u, v = (mesh.uv[own, k] - mesh.uv[own, 0] for k in (1, 2))
        found = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2 * pixels[own]
        texels[own] = np.where(lost[own], 0.0, found)
    has = (area > 0) & (texels > 0)
    if not has.any():
        return 0.0
    density = np.divide(texels, area, out=np.zeros(len(area)), where=area > 0)
    order = np.argsort(density[has])
    so_far = np.cumsum(texels[has][order])
    usual = density[has][order][np.searchsorted(so_far, so_far[-1] / 2)]
    return float(area[density < STARVED * usual].sum() / area.sum())


@kernel
def _count(corners, counter):
    """Count the faces over each pixel centre; corners (F, 3, 2) int64 in 1/1024 pixels, y down.

    Returns twice the signed areas: in y-down pixels positive is clockwise as v goes up.
    """
    height, width = counter.shape
    areas = np.empty(len(corners), np.int64)
    for f in range(len(corners)):
        ax, ay = corners[f, 0, 0], corners[f, 0, 1]
        bx, by = corners[f, 1, 0], corners[f, 1, 1]
        cx, cy = corners[f, 2, 0], corners[f, 2, 1]
        areas[f] = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if areas[f] == 0:
            continue
        if areas[f] < 0:
            bx, by, cx, cy = cx, cy, bx, by

        # An edge that is not top or left loses the points on it
        bias_a = 0 if cy < by or (cy == by and cx > bx) else 1
        bias_b = 0 if ay < cy or (ay == cy and ax > cx) else 1
        bias_c = 0 if by < ay or (by == ay and bx > ax) else 1
        first_row = max(0, -(-min(ay, by, cy) // SUBTEXEL))
        last_row = min(height - 1, max(ay, by, cy) // SUBTEXEL)
        first_col = max(0, -(-min(ax, bx, cx) // SUBTEXEL))
        last_col = min(width - 1, max(ax, bx, cx) // SUBTEXEL)
        for row in range(first_row, last_row + 1):
            y = row * SUBTEXEL
            for col in range(first_col, last_col + 1):
                x = col * SUBTEXEL
                if (
                    (cx - bx) * (y - by) - (cy - by) * (x - bx) >= bias_a
                    and (ax - cx) * (y - cy) - (ay - cy) * (x - cx) >= bias_b
                    and (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= bias_c
                    and counter[row, col] < 65535
                ):
                    counter[row, col] += 1
    return areas
