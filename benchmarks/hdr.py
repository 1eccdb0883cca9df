"""What more than 8 bits buys: one walk around a glossy object, recorded in several ways.

The light is traced once and kept in the cache. A sensor of 30,000 electrons turns it into frames:
at an exposure that suits the object, as films are (highlights are clipped); at one that clips
nothing; and at three, merged. Floats are the light itself, without any sensor.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_exr, write_png
from meshlab_svbrdf.document.mesh_files import write_ply
from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.samples.luminance import decode, encode, luminance
from sample_projects.make_totem import Options, make_scene
from sample_projects.procedural.capture import developed, picture
from sample_projects.procedural.light import Material
from sample_projects.procedural.truth import lights_record, write_truth

from .cases import Case
from .ledger import Ledger, Row, Task
from .solve import Setup, judge, solve
from .tables import Column, Table, table

PART, SCENE = "hdr", "glossy"
OPTIONS = Options(
    frames=120, width=240, height=320, samples=2, columns=64, texture=256, clipped=0.06, views=3,
    materials=(
        Material("terracotta", 0.0, 1.0), Material("lacquer", 4.0, 200.0),
        Material("brass", 2.0, 60.0),
    ),
)  # fmt: skip
VERSION = 1  # of the film: raise it when equal options give other light
WELL, READ = 30_000.0, 5.0  # electrons: what a pixel holds, and the noise of reading it
DARK = 1 / 16  # the exposure that clips nothing, to that of a film
BRIGHTEST = 0.02  # of a view's pixels on the object: highlights

COLUMNS = (
    Column("clipped %", "clipped", "{:.1f}"),
    Column("light °", "light_deg", "{:.3f}"),
    Column("ΔE mean", "dE_mean", "{:.2f}"),
    Column("median", "dE_median", "{:.2f}"),
    Column("ln ρs", "ln_rho_s_worst", "{:+.3f}"),
    Column("ln α", "ln_alpha_worst", "{:+.3f}"),
    Column("highlights, ln", "highlights", "{:.3f}"),
    Column("views dB", "psnr", "{:.1f}"),
    Column("bytes a sample", "bytes", "{:.1f}"),
)


@dataclass(frozen=True)
class Recording:
    """exposures : of every view, the one that stands for it first; bits : 8 or 16, 0: floats
    curve : a camera's own in place of sRGB; settings : of compute_svbrdf_samples
    """

    about: str
    exposures: tuple[float, ...]
    bits: int
    curve: bool = False
    transfer: str = "auto"

    @property
    def settings(self) -> dict[str, str]:
        white = sorted(self.exposures)[(len(self.exposures) - 1) // 2]
        if self.curve:  # what is measured has no scale but that code 128 is sRGB's
            light = np.linspace(0, 1, 100_001)
            white *= float(decode(np.array(128 / 255)))
            white /= float(np.interp(128 / 255, _own_curve(light), light))
        given = {"transfer": self.transfer, "white": str(white), "gains": "none"}
        return {f"compute_svbrdf_samples.{name}": value for name, value in given.items()}


RECORDINGS = {
    "8 bits": Recording("exposed for the object", (1.0,), 8),
    "8 bits, darker": Recording("exposed so that nothing is clipped", (DARK,), 8),
    "16 bits": Recording("exposed for the object", (1.0,), 16),
    "16 bits, darker": Recording("exposed so that nothing is clipped", (DARK,), 16),
    "3 × 8 bits": Recording("three exposures merged", (1.0, 0.25, DARK), 8),
    "3 × 8 bits, measured": Recording(
        "three exposures of a camera with a curve of its own, response measured",
        (1.0, 0.25, DARK), 8, curve=True, transfer="estimate",
    ),
    "floats": Recording("the light itself, OpenEXR", (1.0,), 0),
}  # fmt: skip


@dataclass(frozen=True)
class Film(Case):
    """The traced walk: light, cameras, scan and truth in the cache."""

    @property
    def folder(self) -> Path:
        words = repr((VERSION, OPTIONS))
        return self.cache / f"hdr_{hashlib.sha256(words.encode()).hexdigest()[:8]}"

    @property
    def path(self) -> Path:
        return self.folder / "totem.mlp"

    @property
    def phong(self) -> bool:
        return True


def tasks(ledger: Ledger, cache: Path) -> list[Task]:
    """A row per way of recording."""
    film = Film(SCENE, cache)
    return [
        Task(PART, SCENE, name, f"{made}", partial(_measure, film, made))
        for name, made in RECORDINGS.items()
    ]


def tables(rows: Sequence[Row]) -> list[Table]:
    shown = [row | {"name": f"{row['name']}: {RECORDINGS[row['name']].about}"} for row in rows]
    note = (
        "Clipped: of the samples. Highlights: the root mean square of ln (rendered / true "
        f"luminance) in linear light, over the brightest {BRIGHTEST:.0%} of the object in views "
        "that no frame has."
    )
    return [table("One walk around an object, recorded in several ways", shown, COLUMNS, note,
                  scene=False)]  # fmt: skip


def _measure(film: Film, made: Recording, folder: Path) -> Row:
    light = _trace(film)
    case = _Recorded(film.name, film.cache, folder / "frames" / "totem.mlp", film.truth)
    _record(film, light, made, case.path)
    setup = Setup(texture=OPTIONS.texture, settings=made.settings)
    solved = solve(case, setup, folder / "result")
    row = judge(case, solved, folder)
    store = solved.document.result_folder("samples")
    size = sum(path.stat().st_size for path in store.glob("chunk*.[fv]*.npy"))
    told = solved.document.json("frames")["frames"]
    samples = sum(frame.get("samples", 0) for frame in told)
    return row | {
        "highlights": _highlights(film, solved.document),
        "bytes": size / samples,
        "clipped": _clipped(store),
    }


@dataclass(frozen=True)
class _Recorded(Case):
    """The frames of one recording, with the film's truth."""

    project: Path
    true: Path

    @property
    def path(self) -> Path:
        return self.project

    @property
    def truth(self) -> Path:
        return self.true

    @property
    def phong(self) -> bool:
        return True


@cache
def _scene():
    return make_scene(OPTIONS)


def _trace(film: Film) -> np.ndarray:
    """The light of all frames, (F, H, W, 3) float32; traced, with scan and truth, where it is not
    in the cache."""
    folder = film.folder
    if not (folder / "light.npy").is_file():
        scene, atlas, orbits, views = _scene()
        mesh = scene.surface.mesh
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "ground_truth" / "views").mkdir(parents=True)
        write_ply(folder / "totem.ply", mesh)
        write_truth(
            folder / "ground_truth", scene, atlas, lights_record(scene, mesh, lambda points: points)
        )
        held_out = new_project()
        held_out.add_mesh("totem", folder / "totem.ply")
        for index, camera in enumerate(views):
            rng = np.random.default_rng([OPTIONS.seed, 5, index])
            path = folder / "ground_truth" / "views" / f"view_{index:02d}.png"
            seen = picture(scene, camera, 4, rng)[0]
            write_exr(path.with_suffix(".exr"), seen)
            write_png(path, developed(seen, 0.0, rng))
            held_out.add_raster(path.name, path, camera)
        write_project(held_out, folder / "ground_truth" / "views" / "project.mlp")
        every = [
            picture(scene, camera, OPTIONS.samples, np.random.default_rng([OPTIONS.seed, 4, k]))[0]
            for k, camera in enumerate(chain(*orbits))
        ]
        np.save(folder / "light.part.npy", np.array(every, np.float32))
        (folder / "light.part.npy").rename(folder / "light.npy")
    return np.load(folder / "light.npy", mmap_mode="r")


def _record(film: Film, light: np.ndarray, made: Recording, path: Path) -> None:
    """Frames and project of a recording."""
    path.parent.mkdir(parents=True)
    project = new_project()
    project.add_mesh("totem", film.folder / "totem.ply")
    cameras: list[Camera] = list(chain(*_scene()[2]))
    for k, camera in enumerate(cameras):
        for e, exposure in enumerate(made.exposures):
            rng = np.random.default_rng([OPTIONS.seed, 6, k, e])
            label = f"f{k:03d}_{e}.{'png' if made.bits else 'exr'}"
            file = path.parent / label
            if made.bits == 0:
                write_exr(file, light[k])
            else:
                signal = _sensor(exposure * light[k], rng)
                signal = _own_curve(signal) if made.curve else encode(signal)
                top, kind = (255, np.uint8) if made.bits == 8 else (65535, np.uint16)
                write_png(file, np.rint(top * signal).astype(kind))
            told = exposure if len(made.exposures) > 1 else None
            project.add_raster(label, file, camera, sequence="walk", exposure=told)
    write_project(project, path)


def _sensor(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The signal 0..1 of linear light, with the noise of photons and of reading."""
    electrons = WELL * light
    noise = rng.standard_normal(light.shape) * np.sqrt(electrons + READ**2)
    return np.clip((electrons + noise) / WELL, 0, 1)


def _own_curve(light: np.ndarray) -> np.ndarray:
    """A camera's response: steep in the dark, with a shoulder."""
    return (1 - np.exp(-2.2 * light**0.6)) / (1 - np.exp(-2.2))


def _highlights(film: Film, document: Document) -> float:
    scene, _, _, views = _scene()
    renderer = AcquisitionRenderer(
        document.mesh(), read_appearance(document), read_lights(document)
    )
    errors = []
    for index, camera in enumerate(views):
        rng = np.random.default_rng([OPTIONS.seed, 5, index])
        true, cover = picture(scene, camera, 4, rng)
        got, mine = renderer.render(camera, 4)
        on = (cover > 0.999) & (mine > 0.999)
        true, got = luminance(true)[on], luminance(got)[on]
        high = true >= np.quantile(true, 1 - BRIGHTEST)
        errors.append(np.log(got[high] / true[high]) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(errors))))


def _clipped(store: Path) -> float:
    """Percent of the samples."""
    marks = np.concatenate([np.load(p)[:, 3] & 128 for p in sorted(store.glob("chunk*.value.npy"))])
    return 100 * float(np.mean(marks > 0))
