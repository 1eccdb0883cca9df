"""How near registered cameras come to the true ones, and how long that takes.

Films start from their first camera, photographs from one; the cameras of photographs are compared
with those of structure from motion. A search starts 5° and 5 % of the distance away. Errors are
pixels, RMS over the vertices that the true camera sees. The phone's film starts from picked points,
and its errors are of points on the box, against where the frames show them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import av
import numpy as np
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.bench.workload import Options as Workload
from meshlab_svbrdf.bench.workload import make_workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.registered import camera_from, lens_from
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.raster import rasterise_depth
from meshlab_svbrdf.registration.contrast import to_grey
from meshlab_svbrdf.registration.results import Options
from meshlab_svbrdf.registration.search import InformationSearch
from meshlab_svbrdf.registration.surface import Surface
from meshlab_svbrdf.registration.track import register_frames
from meshlab_svbrdf.script import Step, run_script

from .cases import Case
from .ledger import Row, Task
from .phone_film import K1, box_mesh, make_film
from .scenes.make import cache_folder
from .tables import Column, Table, table

PART = "registration"
REGISTER = "generate_svbrdf_registered_rasters"
FILM, STILLS, SEARCH, HD, PHONE = "film", "photographs", "search", "full HD", "phone"
STEPS = (1, 2)  # of the film's frames that are taken
DEGREES = (0.5, 1.5, 3.0)  # a frame, of the films in full HD
TRIALS = 20
WRONG = 5.0, 0.05  # degrees, share of the distance
LIMIT = {FILM: 1.0, HD: 1.0, STILLS: 5.0, SEARCH: 3.0, PHONE: 3.0}  # pixels that count as right
LENS = {"focal": 1.0, "distortion": str(K1)}  # focal: over the true one
PHONES = {
    "lens known": (LENS, 0.0),
    "box measured 1 mm too large": (LENS, 1.0),
    "focal 10 % off, lens not told": ({"focal": 1.1, "refine_focal": "true"}, 0.0),
}  # what is told, and the box's error


def tasks(films: Sequence[Case], photographs: Sequence[Case], cache: Path | None) -> list[Task]:
    """What is measured of films with a truth, and of photographs.

    cache : of the films in full HD; None: the user's cache
    """
    found = []
    for case in films:
        for step in STEPS:
            for video in (False, True):
                name = f"{'H.264' if video else 'images'}, every {step}. frame"
                make = partial(_film, case, step, video)
                found.append(Task(PART, case.name, f"{FILM}: {name}", "first camera given", make))
        found.append(Task(PART, case.name, SEARCH, f"{TRIALS} trials", partial(_search, case)))
    for name, told in PHONES.items():
        make = partial(_phone, cache, *told)
        found.append(Task(PART, "printed box", f"{PHONE}: {name}", "picked points", make))
    for case in photographs:
        found.append(Task(PART, case.name, STILLS, "one camera given", partial(_stills, case)))
    for degrees in DEGREES:
        make = partial(_full_hd, degrees, cache)
        found.append(Task(PART, "workload", f"{HD}: {degrees:g}° a frame", "60 frames", make))
    return found


def _film(case: Case, step: int, video: bool, folder: Path) -> Row:
    mesh, cameras, frames = _read(case.path, step)
    if video:
        frames = _encoded(frames, folder / "film.mp4")
    return _registered(mesh, cameras, frames, Options(), FILM)


def _phone(cache: Path | None, told: dict[str, str | float], grown: float, folder: Path) -> Row:
    film = make_film((cache or cache_folder()) / "phone_film")
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "box.ply", box_mesh(grown))
    given = {"video": str(film.path), "points": str(film.picks)} | told
    given["focal"] = f"{told['focal'] * film.lens.fx:.1f}"
    document = Document.of_mesh(folder / "box.ply", folder / "out")
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in run_script(document, [Step(REGISTER, given)]):
        pass
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    frames = document.json("registration")["clips"][0]["frames"]
    errors = [
        film.error(frame["index"], camera_from(frame["camera"]), lens_from(frame["lens"]))
        for frame in frames if frame["used"]
    ]  # fmt: skip
    return {"kind": PHONE, "frames": len(frames), "errors": errors, "seconds": wall, "cpu": cpu}


def _stills(case: Case, folder: Path) -> Row:
    mesh, cameras, frames = _read(case.path, 1)
    return _registered(mesh, cameras, frames, Options(ordered=False), STILLS)


def _full_hd(degrees: float, cache: Path | None, folder: Path) -> Row:
    workload = make_workload(cache, 60, Workload(step=degrees, format="h264"))
    mesh, cameras, frames = _read(workload.project, 1)
    return _registered(mesh, cameras, frames, Options(), HD)


def _read(path: Path, step: int) -> tuple[Mesh, list[Camera], list[np.ndarray]]:
    document = Document.open(path)
    rasters = document.rasters[::step]
    with Frames(rasters) as frames:
        images = [to_grey(frames.read(raster)) for raster in rasters]
    return document.mesh(), [raster.camera for raster in rasters], images


def _encoded(frames: Sequence[np.ndarray], path: Path) -> list[np.ndarray]:
    """Frames as a video gives them back: H.264 at its usual quality."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt = "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
        container.mux(stream.encode(None))
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def _registered(
    mesh: Mesh, cameras: list[Camera], frames: list[np.ndarray], options: Options, kind: str
) -> Row:
    wall, cpu = time.perf_counter(), time.process_time()
    found = register_frames(mesh.vertices, mesh.faces, frames, {0: cameras[0]}, options)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    errors = [
        _error(mesh, true, frame.camera)
        for true, frame in zip(cameras, found.frames, strict=True)
        if frame.camera is not None
    ]
    count = len(frames)
    return {"kind": kind, "frames": count, "errors": errors, "seconds": wall, "cpu": cpu}


def _search(case: Case, folder: Path) -> Row:
    """Each trial another frame, turned about the object or about itself by turns."""
    document = Document.open(case.path)
    mesh, rasters = document.mesh(), document.rasters
    rng, search = np.random.default_rng(7), InformationSearch(Surface(mesh.vertices, mesh.faces))
    errors, converged = [], []
    wall, cpu = time.perf_counter(), time.process_time()
    with Frames(rasters) as frames:
        for trial in range(TRIALS):
            raster = rasters[int(rng.integers(len(rasters)))]
            start = _disturbed(raster.camera.about(mesh.center), trial % 2 == 0, rng)
            found = search.refine(frames.read(raster), start.about(-mesh.center))
            errors.append(_error(mesh, raster.camera, found.camera))
            converged.append(found.converged)
    return {
        "kind": SEARCH, "frames": TRIALS, "errors": errors, "converged": converged,
        "seconds": time.perf_counter() - wall, "cpu": time.process_time() - cpu,
    }  # fmt: skip


def _disturbed(camera: Camera, about_object: bool, rng: np.random.Generator) -> Camera:
    degrees, share = WRONG
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    t = camera.t * (1 + share * rng.choice([-1, 1]))
    return replace(camera, R=turn @ camera.R, t=t if about_object else turn @ t)


def _error(mesh: Mesh, true: Camera, found: Camera) -> float:
    """Pixels, RMS over the vertices that the true camera sees."""
    u, v, z = true.project(mesh.vertices).T
    inside = (z > 0) & (u > 0) & (v > 0) & (u < true.width - 1) & (v < true.height - 1)
    index = np.flatnonzero(inside)
    w = rasterise_depth(mesh.vertices, mesh.faces, true)
    depth = w[np.rint(v[index]).astype(int), np.rint(u[index]).astype(int)]
    index = index[z[index] * depth < 1 + 0.01 * mesh.radius * depth]
    points = mesh.vertices[index]
    miss = true.project(points)[:, :2] - found.project(points)[:, :2]
    return float(np.sqrt((miss**2).sum(1).mean()))


def tables(rows: Sequence[Row]) -> list[Table]:
    """One line a film, a set of photographs or a search."""

    def right(row: Row) -> float:
        return float((np.array(row["errors"]) <= LIMIT[row["kind"]]).mean()) * len(row["errors"])

    def said(row: Row) -> str | None:
        if "converged" not in row:
            return None
        good = np.array(row["errors"]) <= LIMIT[SEARCH]
        yes = np.array(row["converged"])
        return f"{(yes & good).sum()} right, {(yes & ~good).sum()} wrong, {(~yes).sum()} refused"

    columns = (
        Column("frames", "frames"),
        Column("registered", lambda row: len(row["errors"])),
        Column("right", right, "{:.0f}"),
        Column("median px", lambda row: float(np.median(row["errors"])), "{:.2f}"),
        Column("worst px", lambda row: max(row["errors"]), "{:.2f}"),
        Column("said", said),
        Column("ms/frame", lambda row: 1000 * row["seconds"] / row["frames"], "{:.0f}"),
        Column("CPU ms/frame", lambda row: 1000 * row["cpu"] / row["frames"], "{:.0f}"),
    )
    limits = ", ".join(f"{kind} {limit:g}" for kind, limit in LIMIT.items())
    return [table("Registration", rows, columns, f"right: within so many pixels: {limits}")]
