"""How well photographs that no stage has seen are predicted: PSNR of the held-out frames.

Every 8th photograph by name, starting with the 4th, is held out (`meshlab-svbrdf run --hold-out`).
For every method alike, one linear gain per channel is fitted to each photograph; PSNR is taken in
sRGB over the pixels of the object (the mask's, where there is one) whose texel is valid in all
methods.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.frames import Frames
from meshlab_svbrdf.document.images import read_mask
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters._matte import matte_texels
from meshlab_svbrdf.filters._stages import read_observations
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.compare import channel_gain, psnr
from meshlab_svbrdf.samples.luminance import decode, encode

from .ablation import GLOSS
from .cases import Case
from .ledger import Ledger, Row, Task
from .peers.statistics import statistic
from .solve import Setup, solve
from .tables import Column, Table, table

PART = "photographs"
PLAIN = "held out"
RAYS = 1.5e6  # about, per picture: small ones are supersampled
NAMES = {
    "mean": "mean of the samples",
    "median": "median of the samples",
    "quantile": "25 % quantile of the samples",
    "statistical": "diffuse colour (statistical)",
    "final": "diffuse colour (final)",
    "full": "diffuse and specular",
}
WITHOUT = {  # ideas that photographs live by, each left out
    "no sheen": {f"{GLOSS}.sheen": "none"},
    "no gains per photograph": {"compute_svbrdf_samples.gains": "none"},
}


def tasks(ledger: Ledger, cases: Sequence[Case], texture: int | None) -> list[Task]:
    """One row a scene, whose table has a line a method, and one for each idea left out."""
    about = f"{texture} texels"
    found = []
    for case in cases:
        found.append(Task(PART, case.name, PLAIN, about, partial(_predict, ledger, case, texture)))
        for name, settings in WITHOUT.items():
            make = partial(_predict, ledger, case, texture, settings=settings)
            found.append(Task(PART, case.name, name, f"{about}, {settings}", make))
    return found


def _predict(
    ledger: Ledger,
    case: Case,
    texture: int | None,
    folder: Path,
    settings: Mapping[str, str] | None = None,
) -> Row:
    base = solve(case, Setup(texture=texture), ledger.work / PART / case.name, hold_out=True)
    if settings is None:
        return predict(base.document) | base.cost
    setup = Setup(texture=texture, settings=settings)
    solved = solve(case, setup, folder, base.document.path.parent, hold_out=True)
    return predict(solved.document, ("full",)) | solved.cost


def predict(document: Document, names: Sequence[str] = tuple(NAMES)) -> Row:
    """PSNR of the held-out frames, by method, and the share of the object's pixels judged.

    names : of the methods, see NAMES. Raises SvbrdfError where no frame was held out.
    """
    if not document.held_out:
        raise SvbrdfError(f"{document.path}: no frame was held out: run with --hold-out")
    colors = _colors(document)
    valid = np.all([np.isfinite(color).all(1) for color in colors.values()], axis=0)
    methods = {name: matte_texels(document, colors[name]) for name in names if name in colors}
    if "full" in names:
        looks = read_appearance(document)
        methods["full"] = AcquisitionRenderer(document.mesh(), looks, read_lights(document))
    observed = matte_texels(document, np.repeat(valid[:, None], 3, 1).astype(np.float32))
    found: dict[str, list[float]] = {name: [] for name in methods}
    shares = []
    frames = Frames(document.held_out)
    for raster in document.held_out:
        size = raster.camera.width, raster.camera.height
        rays = int(np.clip(np.sqrt(RAYS / np.prod(size)), 1, 3))
        truth = decode(frames.read(raster) / 255)
        seen, coverage = observed.render(raster.camera, 1)
        inside = coverage > 0
        if raster.mask is not None:
            inside = read_mask(raster.mask, label=raster.label, size=size)
        on = inside & (coverage > 0) & (seen[..., 0] > 0.999)
        shares.append(float(on.sum() / max(inside.sum(), 1)))
        for name, renderer in methods.items():
            image = renderer.render(raster.camera, rays)[0][on]
            image *= channel_gain(image, truth[on])
            found[name].append(psnr(encode(np.clip(image, 0, 1)), encode(truth[on])))
    return {"frames": len(shares), "share": float(np.mean(shares)), "psnr": found}


def _colors(document: Document) -> dict[str, np.ndarray]:
    """Each method's colour of the texels, (T, 3), 1 = 255."""
    observations = read_observations(document, visibility=False)
    colors = {name: statistic(observations, name) for name in ("mean", "median", "quantile")}
    colors["statistical"] = document.attribute("diffuse")
    colors["final"] = document.attribute("final_diffuse")
    return {name: (color / 100).astype(np.float32) for name, color in colors.items()}


def tables(rows: Sequence[Row]) -> list[Table]:
    """One table a scene, its methods in lines."""
    columns = (
        Column("dB", lambda row: np.mean(row["psnr"]), "{:.2f}"),
        Column("worst", lambda row: min(row["psnr"]), "{:.2f}"),
        Column("above the mean", lambda row: np.mean(row["psnr"]) - row["plain"], "{:+.2f}"),
    )
    made = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = [row for row in rows if row["scene"] == scene]
        lines, title, plain = [], scene, float("nan")
        for row in own:
            if "error" in row:
                lines.append(row)
                continue
            values = {name: list(map(float, each)) for name, each in row["psnr"].items()}
            if row["name"] in (PLAIN, ""):
                plain = float(np.mean(values["mean"]))
                title += (
                    f": {row['frames']} held-out frames; "
                    f"{row['share']:.1%} of the object's pixels judged"
                )
            lines += [
                {
                    "name": NAMES[name] + (f", {row['name']}" if len(values) == 1 else ""),
                    "psnr": each,
                    "plain": plain,
                }
                for name, each in values.items()
            ]
        made.append(table(title, lines, columns, scene=False))
    return made
