"""How far a film is blurred: as pixels alone do it, or by lens, motion and registration as well.

All of them blur highlights alike, and the more the faster the surface turns there. So texels of
different shape tell how far from one material's gloss.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TIMES = (1.0, 1.25, 1.6, 2.0, 3.0, 4.5, 7.0, 10.0)
"""Variances tried, as multiples of what pixels alone have."""
WORTHWHILE = 5e-4
"""Share of what is left unexplained, most of it noise, that more blur must take away."""


def fit_blur(unexplained: Callable[[float], float]) -> float:
    """A film's blur as a multiple of its pixels' own; 1 where more does not clearly serve.

    unexplained : the fit's residual sum of squares under some blur
    """
    # Go on while it gets better, then put a parabola through the best and its neighbours
    rests = [unexplained(TIMES[0])]
    for times in TIMES[1:]:
        rests.append(unexplained(times))
        if rests[-1] >= rests[-2]:
            break
    best = int(np.argmin(rests))
    if not rests[best] < (1 - WORTHWHILE) * rests[0]:
        return 1.0
    if best == len(rests) - 1:
        return TIMES[best]
    around = slice(best - 1, best + 2)
    bend, slope, _ = np.polyfit(np.log(TIMES[around]), rests[around], 2)
    return float(np.exp(np.clip(-slope / (2 * bend), *np.log([TIMES[best - 1], TIMES[best + 1]]))))
