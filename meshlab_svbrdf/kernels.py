"""Whether the kernels are compiled yet: that happens once, and takes a while.

compiled    whether that has happened
compiling   inside it happens, on two cores
"""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from .kernel_list import listed
from .threads import thread_count

SELDOM = 50_000
"""Objects more than before, after which the interpreter looks for garbage: numba's live long."""


def compiled() -> bool:
    """Whether all kernels of a run have been compiled before."""
    return all(is_compiled(kernel) for kernel, _ in listed())


def is_compiled(kernel: Any) -> bool:
    """Whether numba has compiled this version's kernel before, wherever it keeps that."""
    if not hasattr(kernel, "stats"):  # numba is switched off
        return True
    source = Path(kernel.py_func.__code__.co_filename)
    name = f"{source.stem}.{kernel.py_func.__qualname__}-*.nbi"
    kept = Path(str(kernel.stats.cache_path)).glob(name)
    return any(index.stat().st_mtime >= source.stat().st_mtime for index in kept)


@contextmanager
def compiling(say: Callable[[str], None]) -> Iterator[None]:
    """Inside, kernels are compiled as a run comes to them, and where there is another core by a
    second process too, which begins with the last; it ends with this one."""
    if compiled():
        yield
        return
    say("compiling kernels, this happens once and takes half a minute…")
    usual = gc.get_threshold()
    gc.set_threshold(SELDOM, *usual[1:])
    try:
        with _second() if thread_count() > 1 else nullcontext():
            yield
    finally:
        gc.set_threshold(*usual)


@contextmanager
def _second() -> Iterator[None]:
    """It ends when its input does, after the kernel that it is at."""
    command = [sys.executable, "-P", "-m", f"{__package__}.compile_ahead"]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        process.communicate()
