"""Ours and others at the same work, frames to texels and visibility, in seconds and CPU seconds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from meshlab_svbrdf.bench.body import body
from meshlab_svbrdf.bench.child import metered
from meshlab_svbrdf.bench.workload import Workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.visibility import (
    VERTEX_OFFSET,
    directional_visibility,
    spread_directions,
    vertex_visibility,
)
from meshlab_svbrdf.threads import thread_count

from ..ledger import Row
from . import meshlab, open3d

DIRECTIONS = 512
TRIED, TRIED_VERTICES = 600, 4000  # directions and vertices in which the harmonics are judged


def projected_by_us(workload: Workload, size: int, folder: Path) -> Row:
    """Decode, depth, test, sample, weigh and store: the samples filter, kernels warm."""
    for name, place in ((workload.first(2), "warm"), (workload.project, "ours")):
        document = Document.open(name, folder / place)
        document.apply("compute_svbrdf_texels", texture_size=size)
        with metered() as cost:
            document.apply("compute_svbrdf_samples")
    return cost


def projected_by_meshlab(workload: Workload, size: int, folder: Path) -> Row:
    folder.mkdir(parents=True, exist_ok=True)
    radius = workload.scene.mesh.radius
    return meshlab.project_frames(workload.project, folder / "projected.png", size, radius)


def projected_by_open3d(workload: Workload, size: int, folder: Path) -> Row:
    document = Document.open(workload.project, folder)
    mesh, rasters = document.mesh(), document.rasters
    near = replace(mesh, vertices=mesh.vertices - mesh.center)
    about = [replace(r, camera=r.camera.about(mesh.center)) for r in rasters]
    with metered() as cost, Frames(rasters) as frames:
        open3d.project_frames(near, about, (frames.read(r) for r in rasters), size)
    return cost


def visibility(vertices: int) -> Row:
    """Ours against plain Embree; wrong : share of other rays in front that it gets wrong."""
    mesh = body(2 * vertices)
    vertex_visibility(body(12))
    with metered() as ours:
        found = vertex_visibility(mesh, DIRECTIONS)
    with metered() as theirs:
        plain = plain_visibility(mesh, DIRECTIONS)
    return {
        "vertices": len(mesh.vertices),
        "ours": ours | {"wrong": wrong(mesh, found)},
        "embreex": theirs | {"wrong": wrong(mesh, plain)},
    }


def plain_visibility(mesh: Mesh, directions: int) -> np.ndarray:
    """(V, 36): a ray from each vertex in each direction that it faces, on all cores."""
    scene = EmbreeScene(robust=True)
    center, normals = mesh.center, mesh.vertex_normals()
    TriangleMesh(scene, (mesh.vertices - center).astype(np.float32), mesh.faces)
    start = mesh.vertices - center + VERTEX_OFFSET * mesh.radius * normals
    start = start.astype(np.float32)
    omega = spread_directions(directions)
    weights = basis(omega) * (4 * np.pi / directions)

    def sees(k: int) -> np.ndarray:
        seen = normals @ omega[k] > 0
        front = np.flatnonzero(seen)
        ray = omega[k : k + 1].astype(np.float32)
        seen[front] = scene.run(start[front], ray, query="OCCLUDED") < 0
        return seen

    total = np.zeros((len(normals), weights.shape[1]))
    with ThreadPoolExecutor(thread_count()) as pool:
        for first in range(0, directions, 64):
            some = range(first, min(first + 64, directions))
            seen = np.stack(list(pool.map(sees, some)), axis=1)
            total += seen.astype(float) @ weights[some.start : some.stop]
    return total


def wrong(mesh: Mesh, coefficients: np.ndarray) -> float:
    """Share of rays from some vertices into other directions that they face, whose visibility the
    harmonics take for the opposite."""
    some = np.arange(0, len(mesh.vertices), max(1, len(mesh.vertices) // TRIED_VERTICES))
    points, normals = mesh.vertices[some], mesh.vertex_normals()[some]
    omega = spread_directions(TRIED)
    rays = [(direction, None) for direction in omega]
    seen = directional_visibility(mesh, points, normals, rays, VERTEX_OFFSET)
    front = normals @ omega.T > 0
    return float(((coefficients[some] @ basis(omega).T > 0.5) != seen)[front].mean())
