"""Lobes corrected for lamps of known size: a highlight shows both, 1/α_eff = 1/α + a²/4."""

from __future__ import annotations

import numpy as np

from ..errors import SvbrdfError


def under_points(rho_s: float, alpha: float, lamp_radius: float) -> tuple[float, float]:
    """ρs and α as they would be seen under points of light.

    A uniform disk of angular radius a widens a lobe by its variance per axis, a²/4, and lowers its
    top: 1/α = 1/α_eff − a²/4, ρ = ρ_eff α/α_eff.

    rho_s, alpha : as fitted, NaN where unobserved; lamp_radius : degrees, from the object's centre

    Raises SvbrdfError where lamps of this size alone would be seen wider than the lobe is.
    """
    spread = np.radians(lamp_radius) ** 2 / 4
    sharpness = 1 / alpha - spread
    if sharpness <= 0:
        widest = np.degrees(2 / np.sqrt(alpha))
        raise SvbrdfError(
            f"lamp_radius: lamps of {lamp_radius:g}° would give wider highlights than are seen, "
            f"α = {alpha:.0f}; they are smaller than {widest:.2g}°"
        )
    return rho_s / (alpha * sharpness), 1 / sharpness
