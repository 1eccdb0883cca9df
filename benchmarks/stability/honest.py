"""Films that do not fit their mesh, cameras or light, and films that do: what is told of each.

Right films are taken as they are, and changed in one way each. What is wrong must be told, and
nothing of what is right.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import Project, read_project, write_project
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.raster import rasterise
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.samples.luminance import decode, to_srgb8
from meshlab_svbrdf.script import run_script
from sample_projects.make_totem import Options, make_totem
from sample_projects.procedural.recipe import MATERIALS
from tests.analytic import sphere

from ..cases import LONG, PHOTOGRAPHS, SAMPLE, Case

TEXTURE, SIZE = "compute_svbrdf_texels.texture_size", 256
SHIFT = 1 / 32  # of the width: 20 pixels of 640
DARKER = 0.7
SAID = {
    "pixels off in the frames": "cameras off",
    "outline is not found": "not this object",
    "brightness varies": "brightness varies",
    "the light changed": "light changed",
}
"""What the outcome of `compute_svbrdf_samples` says, and the table's word for it."""

Row = dict[str, Any]
Change = Callable[[Project, Mesh, Path], None]


def judge_film(case: Case, folder: Path) -> Row:
    """A film as it is and changed in each way: the numbers, what is told, and what is not."""
    mesh = Document.open(case.path, folder / "looked at").mesh()
    rows = []
    for name, (change, word) in CHANGES.items():
        place = folder / "changed"
        place.mkdir()
        project = read_project(case.path)
        change(project, mesh, place)
        write_project(project, place / case.path.name)
        found = _looked_at(place / case.path.name)
        expected = {word} - {""} - LOST.get(case.name, set()) | OWN.get(case.name, set())
        told = set(found["told"])
        found["broke"] = [f"{w} is not told" for w in sorted(expected - told)]
        if not word:
            found["broke"] += [f"{w} is told of a right film" for w in sorted(told - expected)]
        rows.append({"change": name} | found)
        shutil.rmtree(place)
    return {"changes": rows}


def judge_gloss(cases: Sequence[Case], folder: Path) -> Row:
    """What the whole chain says of the gloss of films, and of the sample made without any."""
    matte = replace(Options(), materials=tuple(replace(m, rho_s=0.0) for m in MATERIALS))
    films = {case.name: (case.path, GLOSSY[case.name]) for case in cases}
    films |= {f"{SAMPLE}, made without gloss": (make_totem(folder / "film", matte).path, 0)}
    rows = []
    for name, (path, glossy) in films.items():
        document = Document.open(path, folder / "out")
        for _ in run_script(document, chain("joint", "standard", {TEXTURE: str(SIZE)})):
            pass
        materials = document.json("materials")["materials"]
        observed = [m for m in materials if m["observed"]]
        reasons = dict.fromkeys(m["reason"] for m in materials if not m["observed"])
        right = bool(observed) == glossy
        rows.append({
            "film": name, "materials": len(materials), "observed": len(observed),
            "reasons": list(reasons), "broke": "" if right else f"{len(observed)} show gloss",
        })  # fmt: skip
        shutil.rmtree(folder / "out")
    return {"gloss": rows}


def _looked_at(project: Path) -> Row:
    document = Document.open(project, project.parent / "out")
    texels, size = TEXTURE.split(".")
    document.apply(texels, **{size: SIZE})
    message = document.apply("compute_svbrdf_samples").message
    record = document.json("frames")
    outline, light = record["outline"] or {}, record["light_change"] or {}
    told = {word for phrase, word in SAID.items() if phrase in message}
    return {
        "pixels": outline.get("pixels"), "agreement": outline.get("agreement"),
        "sides": light.get("sides"),
        "turns": light.get("turns"), "spread": record["gain_spread"], "told": sorted(told),
    }  # fmt: skip


# What is done to a film


def nothing(project: Project, mesh: Mesh, folder: Path) -> None:
    pass


def cut_film(project: Project, mesh: Mesh, folder: Path) -> None:
    """Its first half alone."""
    project.rasters = project.rasters[: len(project.rasters) // 2]


def shift_cameras(project: Project, mesh: Mesh, folder: Path) -> None:
    """All by as much, to one side."""
    for raster in project.rasters:
        camera = raster.camera
        raster.camera = replace(camera, cx=camera.cx + SHIFT * camera.width)


def scatter_cameras(project: Project, mesh: Mesh, folder: Path) -> None:
    """Each by as much, to another side."""
    rng = np.random.default_rng(0)
    for raster in project.rasters:
        camera, angle = raster.camera, rng.uniform(0, 2 * np.pi)
        x, y = SHIFT * camera.width * np.array([np.cos(angle), np.sin(angle)])
        raster.camera = replace(camera, cx=camera.cx + x, cy=camera.cy + y)


def exchange_mesh(project: Project, mesh: Mesh, folder: Path) -> None:
    """An ellipsoid that fills the object's box."""
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    ball = sphere(48, normals=False)
    other = replace(ball, vertices=(low + high) / 2 + ball.vertices * (high - low) / 2)
    path = folder / "other.ply"
    write_ply(path, other, dtype=np.float64)
    project.set_mesh(project.meshes[0].label, path)


def change_exposure(project: Project, mesh: Mesh, folder: Path) -> None:
    """Darker from the middle on, and no EXIF tells it."""
    _change_second_half(project, folder, lambda camera: np.float64(DARKER))


def change_light(project: Project, mesh: Mesh, folder: Path) -> None:
    """From the middle on what faces the place of the first camera is lit less."""
    normals = _face_normals(mesh)
    toward = project.rasters[0].camera.center - mesh.center
    toward /= np.linalg.norm(toward)
    less = np.append(1 - (1 - DARKER) * np.maximum(normals @ toward, 0), 1.0)  # -1: no face

    def factor(camera):
        return less[rasterise(mesh.vertices, mesh.faces, camera)[1]][..., None]

    _change_second_half(project, folder, factor)


def _change_second_half(project: Project, folder: Path, factor) -> None:
    """Multiply the linear light of the later frames; all keep the exposure that EXIF told."""
    with Frames(project.rasters) as frames:
        for k, raster in enumerate(project.rasters):
            raster.exposure = raster.exposure or frames.exposure(raster)
            if 2 * k < len(project.rasters):
                continue
            image = decode(frames.read(raster) / 255) * factor(raster.camera)
            raster.path = folder / f"{k:04d}.png"
            write_png(raster.path, to_srgb8(image))


def _face_normals(mesh: Mesh) -> np.ndarray:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


CHANGES: dict[str, tuple[Change, str]] = {
    "nothing": (nothing, ""),
    "its first half alone": (cut_film, ""),
    "cameras shifted": (shift_cameras, "cameras off"),
    "cameras scattered": (scatter_cameras, "cameras off"),
    "another mesh": (exchange_mesh, "not this object"),
    "exposure halfway": (change_exposure, "brightness varies"),
    "light halfway": (change_light, "light changed"),
}
OWN = {PHOTOGRAPHS: {"brightness varies"}}  # its exposure is automatic
LOST = {PHOTOGRAPHS: {"light changed"}}  # in gold's own gloss
GLOSSY = {SAMPLE: True, LONG: True, PHOTOGRAPHS: False}  # whether gloss can be measured
