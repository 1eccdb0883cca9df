"""How far a filter is: what `apply` calls, and what a shell shows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

Item = TypeVar("Item")
Show = Callable[[float, str], None]


class Progress:
    """`progress(0.3, "frames")`; `for frame in progress.over(frames, "frames"): ...`.

    show : called with the share done in [0, 1] and a word on what is being done; None shows nothing
    """

    def __init__(self, show: Show | None = None) -> None:
        self._show = show

    def __call__(self, fraction: float, message: str = "") -> None:
        if self._show is not None:
            self._show(min(max(float(fraction), 0.0), 1.0), message)

    def over(
        self, items: Iterable[Item], message: str = "", total: int | None = None
    ) -> Iterator[Item]:
        """The items, one by one, telling after each how many of `total` are done."""
        if total is None:
            total = len(items) if isinstance(items, Sized) else 0
        for done, item in enumerate(items, 1):
            yield item
            self(done / total if total else 0.0, message)

    def part(self, start: float, stop: float) -> Progress:
        """The progress of one step that takes this one from `start` to `stop`."""
        return Progress(lambda fraction, message: self(start + (stop - start) * fraction, message))
