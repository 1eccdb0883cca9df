"""One extreme case: how far from the truth, within which bound, or what was said of it."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshlab_svbrdf.errors import SvbrdfError


@dataclass(frozen=True)
class Check:
    """error : in the unit of `what`; bound : it may not exceed; said : the message, in its place"""

    stage: str
    case: str
    what: str
    error: float | None = None
    bound: float | None = None
    said: str = ""
    broke: str = ""

    @property
    def ok(self) -> bool:
        if self.broke:
            return False
        return bool(self.said) or (self.error is not None and self.error <= (self.bound or 0.0))


Case = tuple[str, str, float, Callable[[], float]]
"""Its name, what the error is, its bound, and what measures it."""


def run_cases(stage: str, cases: Iterator[Case]) -> list[Check]:
    """Measure every case. Warnings count as breaking, and so does any error but the suite's own."""
    found = []
    for case, what, bound, measure in cases:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                error = float(measure())
        except SvbrdfError as told:
            found.append(Check(stage, case, what, said=str(told)))
        except Exception as unexpected:
            last = traceback.extract_tb(unexpected.__traceback__)[-1]
            place = f"{Path(last.filename).name}:{last.lineno}"
            broke = f"{type(unexpected).__name__} at {place}: {unexpected}"
            found.append(Check(stage, case, what, broke=broke))
        else:
            broke = "" if np.isfinite(error) else f"the error is {error}"
            found.append(Check(stage, case, what, error, bound, broke=broke))
    return found
