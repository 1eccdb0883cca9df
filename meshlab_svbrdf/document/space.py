"""How much disk and memory still hold."""

from __future__ import annotations

import os
import shutil
from pathlib import Path


def free_bytes(folder: Path) -> int:
    """What may still be written where `folder` is, or will be."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free


def memory_bytes_free() -> float:
    """What this machine's memory still holds; infinite where the system does not tell.

    Files that the system keeps in memory to read them faster make room.
    """
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1024.0 * next(int(x.split()[1]) for x in lines if x.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return _pages("SC_AVPHYS_PAGES")


def memory_bytes() -> float:
    """All of this machine's memory; infinite where the system does not tell."""
    return _pages("SC_PHYS_PAGES")


def _pages(name: str) -> float:
    if name not in getattr(os, "sysconf_names", ()):
        return float("inf")
    return float(os.sysconf(name) * os.sysconf("SC_PAGE_SIZE"))


def in_words(size: float) -> str:
    """Bytes for people: 3.4 GB."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" or size >= 99.5 else f"{size:.2g} {unit}"
        size /= 1000
    return f"{size:.2g} TB" if size < 99.5 else f"{size:.0f} TB"
