"""Whether the kernels are compiled yet: that happens once, and takes a while."""

from __future__ import annotations

from pathlib import Path

from .geometry import texels


def compiled() -> bool:
    """Whether numba has compiled this version's first kernel before, wherever it keeps that."""
    kernel = texels._cover
    if not hasattr(kernel, "stats"):  # numba is switched off
        return True
    source = Path(texels.__file__).stat().st_mtime
    kept = Path(str(kernel.stats.cache_path)).glob("texels._cover-*.nbi")
    return any(index.stat().st_mtime >= source for index in kept)
