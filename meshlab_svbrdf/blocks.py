"""Long arrays block by block: what is computed from a block may be large, the block is not."""

from __future__ import annotations

from collections.abc import Iterator

BLOCK = 1 << 18


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices that cover 0..count in order, `size` elements each but for the last."""
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))
