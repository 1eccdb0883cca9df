"""Peers run on the frames of a result, and scored as the result is."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.images import read_exr, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters._stages import UNOBSERVED_GREY
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

from ..scenes.score import Scores, diffuse, unseen_views
from .capture import Capture, read_capture

PEERS = {  # the file's function
    "mean": "statistics:mean",
    "median": "statistics:median",
    "quantile": "statistics:quantile",
    "meshlab": "meshlab:run",
    "open3d": "open3d:run",
    "mitsuba": "mitsuba_inverse:run",
}
MINUTES = 2.0  # of the inverse rendering, unless said otherwise
SUPERSAMPLING = 3  # as our own results are rendered
Peer = Callable[..., Scores]


def peer_scores(
    project: Path,
    result: Path,
    truth: Path,
    texture: int,
    work: Path,
    names: Sequence[str],
    minutes: float = MINUTES,
) -> dict[str, Scores]:
    """Figures of the diffuse map and of the unseen views of each peer, by its name.

    Parameters
    ----------
    project : the scene's; its frames, but for those held out from the result
    result : NAME.svbrdf of our run on it, with its sample store
    truth : the scene's ground_truth
    texture : texels along each side, those of the result
    work : WORK/NAME/ gets what peer NAME made
    names : of `PEERS`
    minutes : that the inverse rendering may take, scoring not counted

    Returns
    -------
    Per peer the figures of `diffuse` and `unseen_views`, `seconds` (wall clock, of this method
    alone) and what else it tells.

    Raises
    ------
    SvbrdfError : an unknown name; a package that a peer needs is missing, and which extra has it.
    """
    if unknown := sorted(set(names) - set(PEERS)):
        raise SvbrdfError(f"no peer {', '.join(unknown)}; there are {', '.join(PEERS)}")
    capture = read_capture(project, result, texture)
    scores = {}
    for name in names:
        peer = load(name)
        if name == "mitsuba":
            peer = partial(peer, minutes=minutes)
        scores[name] = _score(peer, capture, truth, work / name)
    return scores


def load(name: str) -> Peer:
    """A peer's function; its packages are not imported before."""
    module, function = PEERS[name].split(":")
    return getattr(import_module(f".{module}", __package__), function)


def _score(peer: Peer, capture: Capture, truth: Path, folder: Path) -> Scores:
    folder.mkdir(parents=True, exist_ok=True)
    views = folder / "views"
    shutil.rmtree(views, ignore_errors=True)  # of an earlier run
    figures = peer(capture, truth, folder)
    if not views.is_dir():
        render_matte(capture, folder, truth, views)
    return figures | diffuse(folder, truth) | unseen_views(views, truth)


def render_matte(capture: Capture, folder: Path, truth: Path, views: Path) -> None:
    """The unseen views from a peer's diffuse map alone: no highlights."""
    image = read_exr(folder / "maps" / "diffuse.exr")
    none = np.full(image.shape[:2], np.nan)
    look = Appearance(image, none, none, np.ones_like(image))
    renderer = AcquisitionRenderer(capture.mesh, [look], [])
    grey = float(decode(np.array(UNOBSERVED_GREY / 255)))  # around our own results' renderings too
    views.mkdir()
    for raster in read_project(truth / "views" / "project.mlp").rasters:
        camera = raster.camera.about(capture.center)
        image, coverage = renderer.render(camera, SUPERSAMPLING)
        image += grey * (1 - coverage[..., None])
        write_png(views / raster.path.name, to_srgb8(image))
