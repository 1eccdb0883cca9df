"""What is measured on: scenes that Mitsuba rendered, and longer sequences where they are.

MESHLAB_SVBRDF_SCENES names the folder of the longer ones; without it they are left out.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from .scenes.catalogue import SCENES
from .scenes.make import ensure_scene

LONG = "bust_floods"  # a film with full truth
SAMPLE = "totem"  # the sample project
PHOTOGRAPHS = "goldcape"  # photographs without truth
SAMPLES = Path(__file__).parents[1] / "sample_projects"
VARIABLE = "MESHLAB_SVBRDF_SCENES"


@dataclass(frozen=True)
class Case:
    """name; cache : where the rendered scenes are; path : the project, rendered on first use."""

    name: str
    cache: Path

    @property
    def path(self) -> Path:
        if self.name in SCENES:
            return ensure_scene(SCENES[self.name], self.cache)
        if self.name == SAMPLE:
            return SAMPLES / SAMPLE / f"{SAMPLE}.mlp"
        return Path(os.environ[VARIABLE]) / self.name / f"{self.name}.mlp"

    @property
    def truth(self) -> Path:
        return self.path.parent / "ground_truth"

    @property
    def phong(self) -> bool:
        """Whether every material of the truth is Phong's."""
        materials = json.loads((self.truth / "materials.json").read_text())["materials"]
        return all(m["rho_s"] is not None for m in materials)


def why_not(name: str) -> str:
    """Why a scene cannot be measured here, or \"\"."""
    if name in SCENES or name == SAMPLE:
        return ""
    folder = os.environ.get(VARIABLE)
    if not folder:
        return f"{VARIABLE} names no folder"
    project = Path(folder) / name / f"{name}.mlp"
    return "" if project.is_file() else f"{project} is not there"


def available(names: Iterable[str], cache: Path) -> tuple[list[Case], list[str]]:
    """The scenes that can be measured, and a line on each that cannot."""
    reasons = {name: why_not(name) for name in names}
    cases = [Case(name, cache) for name, reason in reasons.items() if not reason]
    return cases, [f"{name}: left out, {reason}" for name, reason in reasons.items() if reason]
