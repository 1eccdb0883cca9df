"""Compiles the kernels of a run from the last to the first, until its input ends.

Another process compiles them in their order; both keep them in one place, and look there first.
"""

from __future__ import annotations

import gc
import os
import threading
import uuid
from typing import Any

from numba.core.caching import IndexDataCacheFile

from .kernel_list import listed


def main() -> None:
    kernels = listed()
    gc.disable()  # numba's objects live until the end
    ended = threading.Event()

    def wait() -> None:
        os.read(0, 1)
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    for kernel, arguments in reversed(kernels):
        if ended.is_set():
            return
        kernel.compile(arguments)


def _save(file: Any, key: Any, data: Any) -> None:
    """As numba does, but the data before the entry that names them, and under a name that no other
    process takes: whatever another reads or writes meanwhile, no entry leads to other data."""
    name = file._data_name(uuid.uuid4().int >> 64)
    file._save_data(name, data)
    file._save_index({**file._load_index(), key: name})


if __name__ == "__main__":
    setattr(IndexDataCacheFile, "save", _save)  # noqa: B010
    main()
