"""Where tasks run that may run elsewhere: what a scheduler of workers is asked (cluster.py)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class Spread(Protocol):
    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """`work` of every item, in their order. `work` and what it gives are sent: a function of a
        module or an object of a class, with arrays and paths of a folder that all machines have."""
