"""How an object reflects light, recovered from an ordinary video of it, as MeshLab filters.

In Python start with `from meshlab_svbrdf import MeshSet`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .meshset import MeshSet

__version__ = "0.1.0"
__all__ = ["MeshSet"]


def __getattr__(name: str) -> Any:
    """`MeshSet` when it is first asked for: importing pymeshlab takes most of a second."""
    if name == "MeshSet":
        from .meshset import MeshSet

        return MeshSet
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
