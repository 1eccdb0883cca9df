"""Presets: how much time a run may take, as parameters of its filters.

PRESETS    what each is for, and its parameters; the filters' own defaults are `full`
chain      the steps of a run, by estimator, preset and settings

They were chosen by `python -m benchmarks time`: each gives the least error for its time.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from .errors import SvbrdfError
from .script import Step, read_script

SPACING = "compute_svbrdf_samples.spacing"
FRAMES = "compute_svbrdf_samples.frames"
TEXTURE_SIZE = "compute_svbrdf_texels.texture_size"
DIRECTIONS = "compute_svbrdf_visibility.directions"
CHAINS = {"joint": "svbrdf.mlx", "paper": "svbrdf_paper.mlx"}


@dataclass(frozen=True)
class Preset:
    """about : what it is for; parameters : by FILTER.NAME, as text."""

    about: str
    parameters: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        changed = ", ".join(f"{name}={value}" for name, value in self.parameters.items())
        return changed or "the filters' defaults"


PRESETS = {
    "draft": Preset(
        "a look at the result while filming goes on",
        {
            TEXTURE_SIZE: "512",
            SPACING: "6",
            FRAMES: "90",
            DIRECTIONS: "256",
            "generate_svbrdf_environment_map.samples": "500000",
        },
    ),
    "standard": Preset(
        "the default: a frame every 3°, 160 at most",
        {SPACING: "3", FRAMES: "160", DIRECTIONS: "256"},
    ),
    "full": Preset("every frame: the last tenths of a decibel"),
}


def chain(
    estimator: str = "joint",
    preset: str = "standard",
    settings: Mapping[str, Any] | None = None,
    *,
    script: str | Path | None = None,
) -> list[Step]:
    """The steps of a run.

    estimator : "joint" or "paper"; script : a filter script in place of the estimator's chain,
        which no preset changes
    settings : values by FILTER.NAME; they win over the preset

    `paper` follows peaks from frame to frame: no preset leaves frames out of it.

    Raises SvbrdfError where there is no such estimator or preset, or the chain has no such filter.
    """
    for name, known in ((estimator, CHAINS), (preset, PRESETS)):
        if name not in known:
            close = difflib.get_close_matches(name, list(known), 1)
            hint = f", did you mean {close[0]}?" if close else ""
            raise SvbrdfError(f"expected one of {', '.join(known)}, found {name!r}{hint}")
    steps = read_script(script or Path(str(files("meshlab_svbrdf.filters") / CHAINS[estimator])))
    chosen = {} if script else dict(PRESETS[preset].parameters)
    if estimator == "paper":
        for name in (SPACING, FRAMES):
            chosen.pop(name, None)
    for text, value in {**chosen, **(settings or {})}.items():
        steps = with_parameter(steps, *text.rpartition(".")[::2], str(value))
    return steps


def with_parameter(steps: list[Step], filter: str, parameter: str, value: str) -> list[Step]:
    """The steps with one parameter of one filter set."""
    if all(step.name != filter for step in steps):
        raise SvbrdfError(f"the chain has no {filter}, whose parameter {parameter} was to be set")
    return [
        replace(step, parameters=step.parameters | {parameter: value})
        if step.name == filter
        else step
        for step in steps
    ]
