"""The cameras that a registration starts from: aligned rasters, picked points, rough cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.footage import Clip, ClipFrames
from meshlab_svbrdf.document.freshness import split_labels
from meshlab_svbrdf.document.picked_points import read_points
from meshlab_svbrdf.document.reconstruction import read_reconstruction
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.lens import Lens, with_coefficients
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.registration.points import solve_camera_from_points
from meshlab_svbrdf.registration.refine import refine_camera, settle_camera
from meshlab_svbrdf.registration.results import Options

from ._clips import Place, centred_lens, coefficients, find_frame, find_raster, focal_length

PICKED = 2.0 / 1920  # of the frame's longer side, by which a camera from picks may be wrong, RMS
SLIPPED = 0.02  # of the frame's width: picked points that a camera misses by more are wrong

STARTS = (
    Parameter(
        "start", "rasters", "",
        help="Rasters that were aligned in MeshLab, and are frames of the footage.",
    ),
    Parameter(
        "points", "paths", "",
        help="Files of at least four points picked on the mesh and in a frame: CSV, JSON, or the "
        "list that MeshLab's raster alignment exports.",
    ),
    Parameter(
        "camera", "path", "",
        help="Rough cameras of one or more frames (JSON, a MeshLab project, COLMAP …), within "
        "about 5° and 5 % of the distance; mutual information refines them.",
    ),
    Parameter(
        "refine_start", "bool", True,
        help="Move cameras from picked points to where the mesh's silhouette and sharp edges are "
        "the frame's, where it shows them.",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Start:
    """One frame's camera before anything is registered.

    filmed : the camera of the frame as it was filmed, before it is undistorted
    world, pixels : the points that it is to be solved from, in place of `filmed`
    rough : whether it is refined before it is used
    """

    place: Place
    name: str
    filmed: Camera | None
    world: np.ndarray
    pixels: np.ndarray
    rough: bool


def find_starts(
    document: Document, clips: list[Clip], parameters: Namespace, progress: Progress
) -> list[Start]:
    """The frames that cameras are given for.

    Raises SvbrdfError where none is given, or one is of no frame of the footage.
    """
    none = np.zeros((0, 3)), np.zeros((0, 2))
    found = []
    rasters = {raster.label: raster for raster in document.project.rasters}
    for label in split_labels(parameters.start):
        if label not in rasters:
            some = ", ".join(list(rasters)[:5]) or "none"
            raise SvbrdfError(f"no raster is labelled {label!r} (the project's rasters: {some})")
        camera = rasters[label].camera
        if np.array_equal(camera.t, np.zeros(3)):
            raise SvbrdfError(
                f"raster {label!r} stands at the world's origin, as MeshLab sets rasters that are "
                "not aligned: align it in MeshLab, or pick points (points=FILE)"
            )
        place = find_raster(clips, rasters[label], progress)
        found.append(Start(place, f"raster {label!r}", camera, *none, False))
    picked = [each for path in parameters.points for each in read_points(path)]
    for nth, points in enumerate(picked):
        place = find_frame(clips, points.frame, points.where, nth)
        pixels = points.in_frame(*clips[place.clip].size)
        found.append(
            Start(place, points.where, None, points.world, pixels, parameters.refine_start)
        )
    if parameters.camera is not None:
        for foreign in read_reconstruction(parameters.camera).cameras:
            where = f"{parameters.camera}: {foreign.name}"
            try:
                place = find_frame(clips, foreign.name, where)
            except SvbrdfError:
                continue
            _check_size(clips[place.clip], foreign.lens, where)
            c = foreign.lens
            filmed = Camera(c.width, c.height, c.fx, c.fy, c.cx, c.cy, foreign.R, foreign.t)
            found.append(Start(place, where, filmed, *none, True))
        if not any(start.rough and start.filmed is not None for start in found):
            raise SvbrdfError(
                f"{parameters.camera}: none of its cameras is of a frame of the footage, which are "
                f"called {clips[0].names[0]} to {clips[-1].names[-1]}"
            )
    if not found:
        raise SvbrdfError(
            "give a start: start=RASTER aligned in MeshLab, points=FILE of at least four picked "
            "points, or camera=FILE, a rough camera"
        )
    return found


def lens_of(clip: Clip, starts: list[Start], parameters: Namespace) -> Lens | None:
    """The lens of a clip's frames, None where they are not distorted."""
    if parameters.distortion.strip() == "auto":
        return None
    k = coefficients(parameters.distortion)
    if k is None or not any(k):
        return None
    filmed = next((start.filmed for start in starts if start.filmed is not None), None)
    focal = focal_length(clip, parameters)
    if filmed is not None and not (parameters.focal or parameters.focal_mm):
        return with_coefficients(filmed, k)
    if focal is None:
        raise SvbrdfError("distortion needs the focal length it belongs to: give focal, in pixels")
    return centred_lens(clip, focal, k)


def solve_start(
    mesh: Mesh, clip: Clip, start: Start, lens: Lens | None, frames: ClipFrames, frame: int,
    parameters: Namespace,
) -> tuple[Camera, float, str]:  # fmt: skip
    """The start's camera of the undistorted frame, by how many pixels it may be wrong, and what is
    to be said of it.

    frame : where in `frames` it is
    """
    focal = focal_length(clip, parameters)
    if start.filmed is not None:
        camera = start.filmed
        if lens is not None:
            camera = lens.pinhole(camera.R, camera.t)
        elif parameters.focal > 0 or parameters.focal_mm > 0:
            assert focal is not None
            camera = replace(camera, fx=focal, fy=focal * camera.fy / camera.fx)
        said = start.name
    else:
        camera, said = _solve_points(clip, start, lens, focal)
    picked = PICKED * max(clip.size)
    error = Options.start_error if start.filmed is not None else picked
    if not start.rough:
        return camera, error, said
    free = start.filmed is None and focal is None
    refine = settle_camera if start.filmed is None else refine_camera
    refined = refine(mesh.vertices, mesh.faces, frames[frame], camera, free_focal=free)
    if refined.converged:
        return refined.camera, picked, f"{said}, refined"
    if start.filmed is None:
        return camera, error, f"{said}, not refined: the frame does not show the mesh's lines there"
    raise SvbrdfError(
        f"{start.name}: its camera does not converge: mutual information finds no place where mesh "
        "and frame agree; start from within 5° and 5 % of the distance, or pick points"
    )


def _solve_points(
    clip: Clip, start: Start, lens: Lens | None, focal: float | None
) -> tuple[Camera, str]:
    pixels = start.pixels if lens is None else lens.undistort_points(start.pixels)
    if lens is not None:
        focal = lens.pinhole().fx
    if len(pixels) < 4:
        raise SvbrdfError(f"{start.name}: holds {len(pixels)} points, at least 4 are needed")
    try:
        camera = solve_camera_from_points(start.world, pixels, clip.size, focal)
    except ValueError as error:
        raise SvbrdfError(f"{start.name}: {error}") from None
    off = np.linalg.norm(camera.project(start.world)[:, :2] - pixels, axis=1)
    if off.max() > SLIPPED * clip.size[0]:
        raise SvbrdfError(
            f"{start.name}: point {int(off.argmax()) + 1} is {off.max():.0f} pixels from where the "
            f"best camera sees it (all: {np.sqrt((off**2).mean()):.1f} RMS); pick it again"
        )
    estimated = "" if focal is not None else f", focal length {camera.fx:.0f} px from the points"
    return camera, (f"{len(pixels)} points, {np.sqrt((off**2).mean()):.1f} px RMS{estimated}")


def _check_size(clip: Clip, lens: Lens, where: str) -> None:
    if (lens.width, lens.height) != clip.size:
        raise SvbrdfError(
            f"{where}: its frame has {lens.width}×{lens.height} pixels, the footage "
            f"{clip.size[0]}×{clip.size[1]}; give the camera of a frame of that size"
        )
