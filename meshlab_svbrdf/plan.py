"""A plan before the work: what a scene needs, why, and what that will cost.

make_plan    decide from the cameras, the mesh and a few frames

A decision sets a parameter of the chain, unless the user set it. None chooses frames or texels by
how bright they are: that would bias the result.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from . import registry
from .document.coding import Coding
from .document.document import Document
from .document.frames import Frames
from .document.products import plain
from .document.project import RasterEntry
from .document.space import free_bytes, in_words, memory_bytes_free
from .document.space import memory_bytes as machine_bytes
from .errors import DocumentError, SvbrdfError
from .filter import Namespace
from .filters._coding import are_plain
from .filters._frames import choose, frame_sampler, read_reduced, reduction
from .geometry.mesh import Mesh
from .geometry.visibility import needs_visibility
from .planning.cost import (
    SAMPLES,
    Work,
    memory_bytes,
    result_bytes,
    stage_seconds,
    store_bytes,
    this_machine,
)  # fmt: skip
from .planning.resolution import Resolution, resolution
from .planning.trial import (
    ENOUGH_TEXELS,
    RISING,
    Highlights,
    seek_highlights,
    surface_texels,
)
from .presets import TEXTURE_SIZE, with_parameter
from .reflectance.lights import TRUSTED_SAMPLES
from .reflectance.threshold import FEWEST_SAMPLES, MINIMUM_SAMPLES
from .samples.choose_frames import choose_frames
from .samples.chunks import SampledFrame
from .script import Step
from .threads import thread_count

TEXELS, VISIBILITY = "compute_svbrdf_texels", "compute_svbrdf_visibility"
ENVIRONMENT = "generate_svbrdf_environment_map"
PEAKS = "compute_svbrdf_texel_specular.peaks"
GLOSS = "compute_svbrdf_material_specular.gloss"
LEAST = "compute_svbrdf_luminance_threshold.minimum_samples"
COMPARED = "compute_svbrdf_materials.gloss"
FEW = 16
"""Samples of a texel, on average, below which parts of the surface would not have the usual least
number of them (docs/sequences.md)."""
TRIED_FRAMES, TRIED_TEXELS, TIMED_TEXELS = 24, 4000, 65536


@dataclass(frozen=True)
class Decision:
    """about : texture, frames …; choice, reason : in words
    sets : parameters by FILTER.NAME, for the chain; given : the user has chosen
    """

    about: str
    choice: str
    reason: str
    sets: dict[str, str] = field(default_factory=dict)
    given: bool = False


@dataclass(frozen=True)
class Trial:
    """What a few frames told; None where none of them could be read.

    share : of the texels that a frame sees; decode, project : CPU seconds a frame, all texels
    """

    share: float
    decode: float
    project: float
    highlights: Highlights


@dataclass(frozen=True)
class Plan:
    """decisions, and the steps of the chain with what they set
    frames, texels, samples : how many there will be, the last two estimated
    seconds : by filter, estimated for an idle machine; {} where no frame could be tried
    store, results : bytes on disk; free : bytes there; memory : bytes at the peak; memory_free,
        memory_there : bytes that are free, and all of this machine's; infinite if not known
    cores : that work at a time
    """

    decisions: list[Decision]
    steps: list[Step]
    frames: int
    texels: int
    samples: int
    seconds: dict[str, float]
    store: int
    results: int
    free: int
    memory: int
    memory_free: float
    memory_there: float
    cores: int

    @property
    def disk(self) -> int:
        """Bytes that the results will take."""
        return self.store + self.results

    def cost(self) -> str:
        """What it will cost, in a line."""
        takes = f", {_duration(sum(self.seconds.values()))} on {self.cores} idle cores" * bool(
            self.seconds
        )
        return (
            f"about {_millions(self.samples)} samples{takes}, {in_words(self.disk)} on disk "
            f"({in_words(self.free)} are free), {in_words(self.memory)} of memory"
            + f" ({in_words(self.memory_free)} are free)"
            * (self.memory > self.memory_free)
        )

    def short(self) -> list[str]:
        """A few lines: the choices and the cost."""
        choices = "; ".join(f"{d.about} {d.choice}" for d in self.decisions if d.about != "advice")
        return [f"plan: {choices}", f"plan: {self.cost()}"]

    def lines(self) -> list[str]:
        """All of it, with reasons."""
        found = []
        for d in self.decisions:
            chosen = f"{d.choice} (as you set it)" if d.given else d.choice
            found += [f"{d.about:12} {chosen}", f"{'':12} {d.reason}"]
        found.append(f"{'cost':12} {self.cost()}")
        found += [f"{'':12} {name:36} {s:6.1f} s" for name, s in self.seconds.items()]
        return found

    def to_json(self) -> dict[str, Any]:
        """For other programs: sizes in bytes, times in seconds, null where not known."""
        told = {k: v for k, v in vars(self).items() if k not in ("decisions", "steps")}
        return plain({"decisions": [asdict(d) for d in self.decisions]} | told)

    def check_space(self) -> None:
        """Raises SvbrdfError where the disk cannot hold the results, or the memory the run."""
        if self.disk > self.free:
            raise SvbrdfError(
                f"the results need about {in_words(self.disk)} on disk, and "
                f"{in_words(self.free)} are free: use fewer frames "
                f"(--set {SAMPLES}.frames=120), a smaller texture (--texture-size), or another "
                "place (-o)"
            )
        if self.memory > self.memory_there:
            raise SvbrdfError(
                f"the run needs about {in_words(self.memory)} of memory for "
                f"{_millions(self.texels)} texels, and this machine has "
                f"{in_words(self.memory_there)}: use a smaller texture (--texture-size), a simpler "
                "mesh, or another machine"
            )


def make_plan(document: Document, steps: list[Step], given: Mapping[str, Any]) -> Plan:
    """What this scene needs of the chain `steps`, and what that will cost.

    given : what the user set, by FILTER.NAME: it stays

    Raises DocumentError where there are no frames or no mesh.
    """
    if not document.rasters:
        raise DocumentError("the project has no rasters: add registered frames in MeshLab")
    mesh = document.mesh()
    found = resolution(mesh, [raster.camera for raster in document.rasters])
    texture = _texture(found, int(_parameters(steps, TEXELS).texture_size), given)
    side = int(texture.sets.get(TEXTURE_SIZE, _parameters(steps, TEXELS).texture_size))
    texels = max(1, round(found.charts * side * side))

    of_samples = _parameters(steps, SAMPLES)
    choice = choose(document, of_samples, mesh)
    used = len(choice.rasters)
    cameras = [raster.camera for raster in choice.rasters]
    reduce = reduction(of_samples, mesh, side, cameras)
    trial = try_frames(mesh, choice.rasters, of_samples, texels, reduce)
    samples = round((trial.share if trial else 0.5) * texels * used)

    visible, shoots = _visibility(mesh, steps, given)
    decisions = [
        texture,
        _frames(used, len(document.rasters), choice.said, given),
        visible,
        _environment(samples, int(_parameters(steps, ENVIRONMENT).samples), given),
        _highlights(trial, given),
        _reduction(reduce, found.pixels_per_texel(side), given),
    ]
    if trial and (round(trial.share * used) < FEW or LEAST in given):
        decisions.append(_few(round(trial.share * used), given))
    there = {step.name for step in steps}
    for decision in decisions:
        for name, value in decision.sets.items():
            filter, _, parameter = name.rpartition(".")
            if filter in there:
                steps = with_parameter(steps, filter, parameter, value)

    fit = _parameters(steps, "compute_svbrdf_material_specular")
    work = Work(
        frames=used, samples=samples, texels=texels, vertices=len(mesh.vertices),
        environment=float(_parameters(steps, ENVIRONMENT).samples),
        fitted=float(fit.samples) if fit.estimator == "joint" and fit.gloss == "seek" else 0.0,
        directions=int(_parameters(steps, VISIBILITY).directions) if shoots else 0,
        cores=thread_count(),
        decode=trial.decode if trial else 0.0, project=trial.project if trial else 0.0,
    )  # fmt: skip
    held = of_samples.memory << 20
    coding = Coding(of_samples.transfer, of_samples.clip)
    bits = 8 if not choice.brackets and are_plain(choice.rasters, coding) else 16
    return Plan(
        decisions, steps, used, texels, samples,
        stage_seconds(work, this_machine(), fit.estimator, fit.gloss, there)
        if trial
        else {},
        round(store_bytes(samples, texels, used, held, bits)), round(result_bytes(work)),
        free_bytes(document.folder), round(memory_bytes(work, held)),
        memory_bytes_free(), machine_bytes(), work.cores,
    )  # fmt: skip


def _parameters(steps: list[Step], name: str) -> Namespace:
    step = next(step for step in steps if step.name == name)
    return registry.get(name).check(dict(step.parameters))


def _texture(found: Resolution, planned: int, given: Mapping[str, Any]) -> Decision:
    """Textures no finer than the frames; never finer than planned."""
    wanted, asked = found.side, TEXTURE_SIZE in given
    side = planned if asked else min(planned, wanted)
    ratio = found.pixels_per_texel(side)
    reason = f"a texel is {ratio:.1f} of the frames' pixels wide"
    if wanted < side:
        reason += f"; {wanted} would hold all that the frames show"
    elif wanted > side:
        reason += f"; the frames would fill {wanted} (--texture-size {wanted})"
    elif side < planned:
        reason += f": {planned} would only cost time"
    sets = {} if asked or side == planned else {TEXTURE_SIZE: str(side)}
    return Decision("texture", f"{side}×{side}", reason, sets, asked)


def _reduction(reduce: int, ratio: float, given: Mapping[str, Any]) -> Decision:
    if reduce == 1:
        choice, reason = "read whole", f"a texel is {ratio:.1f} of their pixels wide"
    else:
        choice = f"reduced to 1/{reduce}"
        reason = f"a texel is then {ratio / reduce:.1f} pixels wide, and they are read faster"
    return Decision("pixels", choice, reason, {}, f"{SAMPLES}.reduce" in given)


def _frames(used: int, there: int, said: str, given: Mapping[str, Any]) -> Decision:
    names = [f"{SAMPLES}.{name}" for name in ("step", "spacing", "frames")]
    if used == there:
        reason = "all that there are"
    else:
        reason = (
            "spread evenly over the views, by the cameras alone"
            if "evenly" in said
            else f"evenly{said.split(':')[0]}"
        ) + "; more would hardly change the result"
    return Decision(
        "frames", f"{used} of {there}", reason, given=any(name in given for name in names)
    )


def _few(samples: int, given: Mapping[str, Any]) -> Decision:
    """How many samples a texel must have, where it has few."""
    asked = LEAST in given
    least = FEWEST_SAMPLES if TRUSTED_SAMPLES <= samples < FEW else MINIMUM_SAMPLES
    reason = f"a texel is seen by about {samples} frames: "
    if samples < TRUSTED_SAMPLES:
        reason += f"below {TRUSTED_SAMPLES} lights and gloss are not to be trusted; take more"
    elif samples < FEW:
        reason += f"parts of the surface would not have the usual {MINIMUM_SAMPLES}"
    else:
        reason += f"the usual least number is {MINIMUM_SAMPLES}"
    return Decision(
        "threshold", f"from {given[LEAST] if asked else least} samples on", reason,
        {} if asked or least == MINIMUM_SAMPLES else {LEAST: str(least)}, asked,
    )  # fmt: skip


def _visibility(mesh: Mesh, steps: list[Step], given: Mapping[str, Any]) -> tuple[Decision, bool]:
    """What compute_svbrdf_visibility will do, and whether it shoots."""
    name = f"{VISIBILITY}.mode"
    mode = _parameters(steps, VISIBILITY).mode
    needed, blocked = needs_visibility(mesh)
    shoots = mode == "always" or (mode == "auto" and needed)
    reason = f"{blocked:.1%} of the rays are blocked" + (
        "" if needed else ": the object hardly shadows itself"
    )
    return Decision("visibility", "yes" if shoots else "no", reason, given=name in given), shoots


def _environment(samples: int, most: int, given: Mapping[str, Any]) -> Decision:
    name = f"{ENVIRONMENT}.samples"
    if samples > most:
        choice, reason = (
            f"from {_millions(most)} samples",
            (f"of every {samples / most:.0f}th texel or so; more only cost time"),
        )
    else:
        choice, reason = "from all samples", "there are no more than it needs"
    return Decision("environment", choice, reason, given=name in given)


def _highlights(trial: Trial | None, given: Mapping[str, Any]) -> Decision:
    asked = GLOSS in given or PEAKS in given
    if trial is None:
        return Decision("highlights", "sought", "no frame could be read to tell", given=asked)
    h = trial.highlights
    if h.none:
        reason = (
            f"samples of {h.judged:,} texels in a few frames spread evenly about their medians, "
            f"and {h.rising or 'none'} of them rise{'s' * (h.rising < 2)} far above"
        )
        spared = {PEAKS: "none", GLOSS: "none"} | ({} if asked else {COMPARED: "false"})
        sets = {name: value for name, value in spared.items() if name not in given}
        return Decision("highlights", "not sought" if sets else "sought", reason, sets, asked)
    reason = f"{h.rising:,} of {h.judged:,} texels tried rise far above their noise"
    if h.judged < ENOUGH_TEXELS or h.rising <= RISING * h.judged:
        reason = f"one cannot tell from {h.judged:,} texels tried that there are none"
    return Decision("highlights", "sought", reason, given=asked)


def try_frames(
    mesh: Mesh, rasters: list[RasterEntry], parameters: Namespace, texels: int, reduce: int
) -> Trial | None:
    """A few frames, evenly chosen and reduced, projected to a few points of the surface."""
    cameras = [raster.camera.reduced(reduce) for raster in rasters]
    few = frame_sampler(mesh, surface_texels(mesh, TRIED_TEXELS), cameras, parameters, reduce)
    many = frame_sampler(mesh, surface_texels(mesh, TIMED_TEXELS), cameras, parameters, reduce)
    samples: list[SampledFrame] = []
    decode: list[float] = []
    base: list[float] = []
    whole: list[float] = []
    for k in choose_frames(cameras, mesh.center, mesh.radius, TRIED_FRAMES):
        camera = cameras[k]
        start = time.thread_time()
        try:
            with Frames([rasters[k]]) as frames:
                image, mask = read_reduced(frames, rasters[k], reduce)
        except DocumentError:
            continue  # compute_svbrdf_samples says which, and what to do
        decode.append(time.thread_time() - start)
        if not samples:
            few.sample(camera, image, mask)  # load or compile the kernels
        start = time.thread_time()
        samples.append(few.sample(camera, image, mask))
        base.append(time.thread_time() - start)
        if len(whole) < TRIED_FRAMES // 4:
            start = time.thread_time()
            many.sample(camera, image, mask)
            whole.append(time.thread_time() - start)
    if not samples:
        return None
    share = np.mean([len(texel) for texel, _ in samples]) / TRIED_TEXELS
    fixed, more = float(np.median(base)), float(np.median(whole))
    each = max(0.0, more - fixed) / (TIMED_TEXELS - TRIED_TEXELS)
    project = max(0.0, fixed - each * TRIED_TEXELS) + each * texels
    return Trial(
        float(share), float(np.median(decode)), project, seek_highlights(samples, TRIED_TEXELS)
    )


def _millions(count: float) -> str:
    return f"{count / 1e6:.2g} M" if count < 99.5e6 else f"{count / 1e6:,.0f} M"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
