"""The whole chain on strange meshes and strange frames whose answer is known all the same.

Where every frame is of one colour, that is the diffuse colour of every texel of any shape, and no
gloss is observed. What cannot be used is refused by one message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.samples.luminance import decode
from meshlab_svbrdf.script import run_script
from tests.analytic import look_at, orbit, plane, sphere

from .checks import Case

GREY, SIZE, FRAMES = 120, (64, 48), 48
EXACT = 2e-4  # of 100: D of constant samples, in single precision
Frames = Callable[[int, Camera], np.ndarray]


def cases(folder: Path) -> Iterator[Case]:
    for name, mesh in meshes().items():
        yield name, "D, of 100", EXACT, partial(_grey, folder / f"mesh {name}", mesh)
    for name, make in FILMS.items():
        yield name, "D, of 100", EXACT, partial(make, folder / f"film {name}")
    for name, make in EMPTY.items():
        yield name, "texels, materials observed", 0.0, partial(make, folder / f"film {name}")


def meshes() -> dict[str, Mesh]:
    ball = sphere(8, normals=False)
    far = np.eye(4)
    far[:3, 3] = 1e6, -1e6, 5e5
    faces = np.arange(len(ball.faces))
    degenerate = np.concatenate([ball.faces, ball.faces[:5, [0, 0, 1]], ball.faces[:5, [2, 2, 2]]])
    wedge = Mesh(
        np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0.2, 0], [0, 1, 0.0]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32), None,
        np.array([[[0, 0], [0, 0.9], [0.3, 0]], [[0.4, 0], [0.4, 0.9], [0.6, 0]],
                  [[0.7, 0], [0.7, 0.9], [1, 0]]]),
    )  # fmt: skip
    assert ball.uv is not None
    folded = ball.uv.copy()
    folded[..., 0] = np.abs(folded[..., 0] - 0.5)
    holes = ball.vertices.copy()
    holes[7, 1] = np.nan
    lost = ball.uv.copy()
    lost[3, 1, 0] = np.nan
    odd, half = faces % 2 == 1, len(faces) // 2
    flat = np.where((faces % 3 == 0)[:, None, None], 0.5, ball.uv)
    return {
        "a plane": plane(1.0, cells=4),
        "one triangle": replace(plane(), faces=plane().faces[:1], uv=plane().uv[:1]),
        "a sphere": ball,
        "a needle, 1 : 20": replace(ball, vertices=ball.vertices * [0.05, 1, 0.05]),
        "a needle, 1 : 10⁴": replace(ball, vertices=ball.vertices * [1e-4, 1, 1e-4]),
        "a sheet, 1 : 10⁶": replace(ball, vertices=ball.vertices * [1, 1, 1e-6]),
        "at a million metres": ball.transformed(far),
        "a thousand kilometres wide": replace(ball, vertices=ball.vertices * 1e6),
        "a millimetre wide, in metres": replace(ball, vertices=ball.vertices * 1e-3),
        "a micrometre wide, in metres": replace(ball, vertices=ball.vertices * 1e-6),
        "degenerate triangles": Mesh(
            ball.vertices, degenerate.astype(np.int32), None,
            np.concatenate([ball.uv, ball.uv[:5], ball.uv[:5]]),
        ),
        "duplicate triangles": Mesh(
            ball.vertices, np.repeat(ball.faces, 2, 0), None, np.repeat(ball.uv, 2, 0)
        ),
        "three faces at an edge": wedge,
        "open": Mesh(ball.vertices, ball.faces[:half], None, ball.uv[:half]),
        "flipped normals": replace(ball, faces=ball.faces[:, ::-1].copy(), uv=ball.uv[:, ::-1]),
        "half of the faces flipped": Mesh(
            ball.vertices, np.where(odd[:, None], ball.faces[:, ::-1], ball.faces), None,
            np.where(odd[:, None, None], ball.uv[:, ::-1], ball.uv),
        ),
        "no texture coordinates": replace(ball, uv=None),
        "a third of the charts without area": replace(ball, uv=flat),
        "all charts without area": replace(ball, uv=ball.uv * 0),
        "charts over each other": replace(ball, uv=folded),
        "charts far outside of the texture": replace(ball, uv=ball.uv + 1e9),
        "a vertex that is not finite": replace(ball, vertices=holes),
        "a texture coordinate that is not finite": replace(ball, uv=lost),
        "all vertices in one place": replace(ball, vertices=ball.vertices * 0),
    }  # fmt: skip


def _written(folder: Path, mesh: Mesh, cameras: list[Camera], frame: Frames) -> Document:
    (folder / "frames").mkdir(parents=True)
    path = folder / "mesh.ply"
    try:
        write_ply(path, mesh, dtype=np.float64)
    except Exception:  # what we do not write, others do
        good = replace(mesh, vertices=np.nan_to_num(mesh.vertices),
                       uv=None if mesh.uv is None else np.nan_to_num(mesh.uv, nan=7.0))  # fmt: skip
        write_ply(path, good, dtype=np.float64)
        bad = mesh.vertices if not np.isfinite(mesh.vertices).all() else mesh.uv
        assert bad is not None
        _plant_nan(path, 0.0 if bad is mesh.vertices else 7.0, bad)
    project = new_project()
    project.add_mesh("object", path)
    for k, camera in enumerate(cameras):
        image = folder / "frames" / f"f{k:03d}.png"
        write_png(image, frame(k, camera))
        project.add_raster(image.name, image, camera, sequence="walk")
    write_project(project, folder / "object.mlp")
    return Document.open(folder / "object.mlp", folder / "out")


def _plant_nan(path: Path, number: float, values: np.ndarray) -> None:
    """Put a NaN where the file holds what stood in its place."""
    single = values.ndim == 3  # texture coordinates are single in files
    data = bytearray(path.read_bytes())
    where = np.flatnonzero(~np.isfinite(values.ravel()))[0]
    if single:
        at = data.index(np.float32(number).tobytes())
        data[at : at + 4] = np.float32(np.nan).tobytes()
    else:
        body = data.index(b"end_header\n") + len(b"end_header\n")
        data[body + 8 * where : body + 8 * where + 8] = np.float64(np.nan).tobytes()
    path.write_bytes(data)


def _around(mesh: Mesh, count: int = FRAMES) -> list[Camera]:
    """Cameras that see the object whole, wherever and however large it is."""
    finite = mesh.vertices[np.isfinite(mesh.vertices).all(1)]
    center = (finite.min(0) + finite.max(0)) / 2
    radius = max(float(np.linalg.norm(np.ptp(finite, axis=0))) / 2, 1e-9)
    near = orbit(count, distance=2.5, turns=3, climb=120, width=SIZE[0], height=SIZE[1], fx=60.0)
    return [
        replace(c, t=radius * c.t - c.R @ center) for c in near
    ]  # fmt: skip


def _plain(k: int, camera: Camera) -> np.ndarray:
    return np.full((camera.height, camera.width, 3), GREY, np.uint8)


def _run(document: Document) -> Document:
    steps = chain("joint", "standard", {"compute_svbrdf_texels.texture_size": "48"})
    for _ in run_script(document, steps):
        pass
    document.save()
    return document


def _judged(document: Document, code: float) -> float:
    """The largest error of D, of 100; infinite where gloss is claimed or nothing is seen."""
    diffuse = document.attribute("diffuse")
    seen = np.isfinite(diffuse).all(1)
    materials = document.json("materials")["materials"]
    if not seen.any() or any(material["observed"] for material in materials):
        return np.inf
    final = document.attribute("final_diffuse")[seen]
    expected = 100 * float(decode(np.array(code / 255)))
    return max(np.abs(diffuse[seen] - expected).max(), np.nanmax(np.abs(final - expected)))


def _grey(folder: Path, mesh: Mesh) -> float:
    return _judged(_run(_written(folder, mesh, _around(mesh), _plain)), GREY)


def _film(folder: Path, cameras: list[Camera], frame: Frames, code: float = GREY) -> float:
    return _judged(_run(_written(folder, sphere(8), cameras, frame)), code)


def _all(code: int, folder: Path) -> float:
    cameras = _around(sphere(8))
    return _film(folder, cameras, lambda k, c: _plain(k, c) * 0 + np.uint8(code), code)


def _one_color(folder: Path) -> float:
    def blue(k: int, camera: Camera) -> np.ndarray:
        return np.broadcast_to(np.uint8([0, 0, 200]), (camera.height, camera.width, 3))

    document = _run(_written(folder, sphere(8), _around(sphere(8)), blue))
    diffuse = document.attribute("diffuse")
    expected = 100 * decode(np.array([0, 0, 200]) / 255)
    return float(np.abs(diffuse[np.isfinite(diffuse).all(1)] - expected).max(initial=0))


def _noise(folder: Path) -> float:
    """Materials with gloss, of frames that show nothing but noise."""
    rng = np.random.default_rng(0)

    def chance(k: int, camera: Camera) -> np.ndarray:
        return rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)

    document = _run(_written(folder, sphere(8), _around(sphere(8)), chance))
    return float(sum(m["observed"] for m in document.json("materials")["materials"]))


def _few(count: int, folder: Path) -> float:
    """Fewer than eight samples observe no texel, and no number is made up."""
    document = _run(_written(folder, sphere(8), _around(sphere(8), count), _plain))
    materials = document.json("materials")["materials"]
    seen = np.isfinite(document.attribute("diffuse")) | np.isfinite(
        document.attribute("final_diffuse")
    )
    return float(seen.sum() + sum(material["observed"] for material in materials))


def _alike(folder: Path) -> float:
    """All frames from next to one place."""
    first = _around(sphere(8))[3]
    cameras = [replace(first, t=first.t + 1e-7 * k) for k in range(FRAMES)]
    return _film(folder, cameras, _plain)


def _sizes(folder: Path) -> float:
    """Frames of different sizes, upright and lying, each with its own camera."""
    shapes = [(64, 48), (48, 64), (200, 150), (33, 47)]
    eyes = [c.center for c in _around(sphere(8))]
    cameras = [
        look_at(eye, width=shapes[k % 4][0], height=shapes[k % 4][1], fx=1.1 * min(shapes[k % 4]))
        for k, eye in enumerate(eyes)
    ]
    return _film(folder, cameras, _plain)


def _other_size(folder: Path) -> float:
    def small(k: int, camera: Camera) -> np.ndarray:
        return np.full((camera.height // 2, camera.width // 2, 3), GREY, np.uint8)

    return _film(folder, _around(sphere(8)), small)


def _away(folder: Path) -> float:
    """No camera sees the object."""
    cameras = [replace(c, R=np.diag([-1, 1, -1]) @ c.R, t=np.diag([-1, 1, -1]) @ c.t)
               for c in _around(sphere(8))]  # fmt: skip
    return _film(folder, cameras, _plain)


def _inside(folder: Path) -> float:
    """The cameras stand inside the object."""
    cameras = [replace(c, t=0.1 * c.t) for c in _around(sphere(8))]
    return _film(folder, cameras, _plain)


EMPTY: dict[str, Callable[[Path], float]] = {
    "frames of noise: gloss": _noise, "one frame": partial(_few, 1), "two frames": partial(_few, 2),
    "seven frames": partial(_few, 7),
}  # fmt: skip
"""Films of which nothing may be claimed."""
FILMS: dict[str, Callable[[Path], float]] = {
    "black frames": partial(_all, 0), "white frames, all clipped": partial(_all, 255),
    "frames of code 1": partial(_all, 1), "frames of one colour": _one_color,
    "frames all alike": _alike,
    "frames of different sizes": _sizes, "frames of another size than their cameras'": _other_size,
    "cameras that look away": _away, "cameras inside the object": _inside,
}  # fmt: skip
