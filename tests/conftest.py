"""A small project and small filters, for everything that runs filters without caring which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from meshlab_svbrdf import kernels, registry
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels

settings.register_profile("svbrdf", deadline=None, derandomize=True)  # seeded, none timed
settings.load_profile("svbrdf")

FRAMES = 9


@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    """Commands start no second process that compiles: the tests' processes share what they do."""
    monkeypatch.setattr(kernels, "compiled", lambda: True)


def tetrahedron(uv: bool = True) -> Mesh:
    """Four faces in the four quarters of the texture."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64) + 0.1
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    corner = np.array([[0.05, 0.05], [0.45, 0.05], [0.05, 0.45]])
    offset = np.array([[0, 0], [0.5, 0], [0, 0.5], [0.5, 0.5]])
    return Mesh(vertices, faces, uv=corner[None] + offset[:, None] if uv else None)


def write_small_project(folder: Path, *, uv: bool = True, matrix: np.ndarray | None = None) -> Path:
    """FOLDER/small.mlp: a tetrahedron, turned and moved by its layer's matrix, and nine frames."""
    (folder / "frames").mkdir(parents=True)
    write_ply(folder / "mesh.ply", tetrahedron(uv), dtype=np.float64)
    if matrix is None:
        matrix = np.array([[0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1.0]])
    project = new_project()
    project.add_mesh("stone", folder / "mesh.ply", matrix)
    for k in range(FRAMES):
        path = folder / "frames" / f"f{k}.png"
        write_png(path, np.full((6, 8, 3), 20 * k, np.uint8))
        camera = Camera(8, 6, 10.0, 10.0, 3.5, 2.5, np.eye(3), np.array([0.1 * k, 0.2, 9.0]))
        project.add_raster(path.name, path, camera)
    write_project(project, folder / "small.mlp")
    return folder / "small.mlp"


def _texels(document, parameters, progress):
    mesh = document.mesh()
    if mesh.uv is None:
        document.set_uv(tetrahedron().uv)
        mesh = Mesh(mesh.vertices, mesh.faces, uv=tetrahedron().uv)
    texels = rasterise_texels(mesh, ((parameters.size, parameters.size),))
    document.set_texels(texels)
    return f"{len(texels)} texels"


def _shade(document, parameters, progress):
    texels = document.texels()
    value = texels.position @ np.array([1, 2, 3], np.float32) * parameters.scale
    document.set_attribute("height", value)
    document.set_map("height", texels.to_images(value))
    image = [
        np.uint8(60) + np.uint8(9) * plane.astype(np.uint8) for plane in texels.to_images(value, 0)
    ]
    document.set_map("diffuse", [np.repeat(plane[..., None], 3, 2) for plane in image], kind="png")
    document.show_map("height", "diffuse")
    document.set_json("frames", {"frames": [{"label": r.label} for r in document.rasters]})
    (document.staged_folder("samples") / "chunk.bin").write_bytes(b"\1" * 10)
    for done in progress.over(range(4), "shading"):
        if parameters.fail == "error" and done == 2:
            raise SvbrdfError("the demo fails as asked")
        if parameters.fail == "interrupt" and done == 2:
            raise KeyboardInterrupt
    return "shaded"


def _edit(document, parameters, progress):
    document.set_attribute("height", document.attribute("height") + parameters.add)
    return "edited"


DEMOS = (
    Filter(
        "compute_demo_texels",
        "Demo: texels",
        ("mesh",),
        ("texels",),
        (
            Parameter(
                "size", "int", 16, minimum=4, maximum=64, unit="pixels", help="Of the texture."
            ),
        ),
        help="Rasterises.",
        reference="Nobody 2012, §1",
        apply=_texels,
    ),
    Filter(
        "compute_demo_shade",
        "Demo: shade",
        ("texels", "rasters"),
        ("shade",),
        (
            Parameter("scale", "float", 1.0, minimum=0.0),
            Parameter("fail", "enum", "no", choices=("no", "error", "interrupt")),
            Parameter("near", "length", "10%"),
            Parameter("image", "path", ""),
            Parameter("stroke", "points", ()),
        ),
        apply=_shade,
    ),
    Filter(
        "apply_demo_edit",
        "Demo: edit",
        ("texels", "shade"),
        ("shade",),
        (Parameter("add", "float", 1.0),),
        apply=_edit,
    ),
)


@pytest.fixture(scope="session")
def stone() -> Mesh:
    """The tetrahedron of the small project, in its own coordinates."""
    return tetrahedron()


@pytest.fixture
def small_project_at():
    """Writes the small project into a folder: see write_small_project."""
    return write_small_project


@pytest.fixture
def small_project(tmp_path) -> Path:
    return write_small_project(tmp_path / "in")


@pytest.fixture
def demos(monkeypatch) -> dict[str, Filter]:
    """The demo filters take the place of all others."""
    found = {filter.name: filter for filter in DEMOS}
    monkeypatch.setattr(registry, "filters", lambda: found)
    return found
