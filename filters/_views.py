"""Images from cameras: a project's, on a smooth way over them, or around the object."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.document.video_writer import writing_video
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Namespace, Parameter
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.progress import Progress
from meshlab_svbrdf.rendering.paths import fitting, smooth_way, turntable, upward
from meshlab_svbrdf.rendering.surface import SurfaceRenderer
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ._stages import UNOBSERVED_GREY

REFLECTANCE = Parameter(
    "reflectance", "enum", "best", choices=("best", "phong"),
    help="Microfacets where they describe a material better, or Phong's lobe everywhere.",
)  # fmt: skip
LAMP_RADIUS = Parameter(
    "lamp_radius", "float", 0.0, minimum=0.0, maximum=20.0, unit="degrees",
    help="Of the lamps, as seen from the object, if it is known: shadows of large lamps "
    "have soft edges.",
)  # fmt: skip
SUPERSAMPLING = Parameter(
    "supersampling", "int", 3, minimum=1, maximum=8, help="Rays per pixel and direction."
)
BACKGROUND = Parameter(
    "background", "int", UNOBSERVED_GREY, minimum=0, maximum=255,
    help="The grey around the object, an sRGB code.",
)  # fmt: skip
VIEWS = (
    Parameter(
        "cameras", "path", "",
        help="A project whose rasters are the views; empty: this one's own.",
    ),
    Parameter(
        "path", "enum", "cameras", choices=("cameras", "smooth", "turntable"),
        help='Which views: "cameras", each raster\'s; "smooth", a film over all rasters in their '
        'order; "turntable", a walk around the object, about what is upright in the rasters.',
    ),
    Parameter(
        "frames", "int", 120, minimum=2, maximum=100000,
        help="Of a smooth path or a turntable.",
    ),
    Parameter(
        "elevation", "float", 15.0, minimum=-89.0, maximum=89.0, unit="degrees",
        help="Of a turntable's camera above the horizon.",
    ),
    Parameter(
        "distance", "length", 0.0, minimum=0.0,
        help="Of a turntable's camera from the object's centre; 0: the whole object fits.",
    ),
    Parameter(
        "size", "float", 1.0, minimum=0.02, maximum=8.0,
        help="Columns and rows of an image against the camera's: .25 with supersampling=1 is a "
        "preview.",
    ),
    Parameter(
        "folder", "path", "",
        help="Where the images go, one PNG per raster under its file's name, or frame_0000.png "
        "onwards.",
    ),
    Parameter(
        "video", "path", "", help="An MP4 of the images, in their order; with or without a folder."
    ),
    Parameter(
        "rate", "int", 30, minimum=1, maximum=240, unit="frames a second", help="Of the video."
    ),
    SUPERSAMPLING,
)  # fmt: skip


def views(document: Document, parameters: Namespace) -> list[tuple[str, Camera]]:
    """The cameras to render, and their images' names; SvbrdfError where there are none."""
    if parameters.folder is None and parameters.video is None:
        raise SvbrdfError("folder is empty: say where the images go")
    project = document.project if parameters.cameras is None else read_project(parameters.cameras)
    if not project.rasters:
        raise SvbrdfError(f"{project.path}: has no rasters to take cameras from")
    cameras = [raster.camera for raster in project.rasters]
    if parameters.path == "cameras":
        names = [Path(raster.path.name).with_suffix(".png").name for raster in project.rasters]
        if parameters.folder is not None and len(set(names)) < len(names):
            raise SvbrdfError(
                f"{project.path}: two rasters have the same file name, and would overwrite each "
                "other"
            )
    else:
        names = [f"frame_{k:04d}.png" for k in range(parameters.frames)]
        cameras = _path(document, cameras, parameters, f"{project.path}: ")
    cameras = [camera.scaled(parameters.size) for camera in cameras]
    return list(zip(names, cameras, strict=True))


def _path(
    document: Document, cameras: list[Camera], parameters: Namespace, where: str
) -> list[Camera]:
    if parameters.path == "smooth":
        try:
            return smooth_way(cameras, parameters.frames)
        except ValueError as error:
            raise SvbrdfError(f"{where}{error}; give other cameras") from None
    mesh, distance, up = document.mesh(), parameters.distance, upward(cameras)
    if 0 < distance <= mesh.radius:
        raise SvbrdfError(
            f"distance is {distance:.3g}, within the object's radius of {mesh.radius:.3g}"
        )
    elevation = parameters.elevation
    distance = distance or fitting(cameras[0], mesh.center, mesh.vertices, up, elevation)
    return turntable(
        cameras[0], mesh.center, mesh.radius, up, parameters.frames, elevation, distance
    )


def render_views(
    renderer: SurfaceRenderer, wanted: list[tuple[str, Camera]], parameters: Namespace,
    progress: Progress,
) -> str:  # fmt: skip
    """Write the images and the video; what there is, in words."""
    grey = float(decode(np.array(parameters.background / 255)))
    with _output(parameters) as write:
        for name, camera in progress.over(wanted, "views"):
            image, coverage = renderer.render(camera, parameters.supersampling)
            write(name, to_srgb8(image + grey * (1 - coverage[..., None])))
    return f"{len(wanted)} views in " + " and ".join(
        str(place) for place in (parameters.folder, parameters.video) if place is not None
    )


@contextmanager
def _output(parameters: Namespace) -> Iterator[Callable[[str, np.ndarray], None]]:
    """Where images go, by name: the folder, the video, or both."""
    folder, video = parameters.folder, parameters.video

    def to_folder(name: str, image: np.ndarray) -> None:
        if folder is not None:
            write_png(folder / name, image)

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    if video is None:
        yield to_folder
        return
    video.parent.mkdir(parents=True, exist_ok=True)
    with writing_video(video, parameters.rate) as append:

        def to_both(name: str, image: np.ndarray) -> None:
            to_folder(name, image)
            append(image)

        yield to_both
