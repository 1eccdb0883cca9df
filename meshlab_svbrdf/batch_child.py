"""`meshlab-svbrdf` as a batch starts it: it ends where the batch, or the worker that does its work,
dies, so that it lets go of its project, which may be tried again.

watch    end this process with the one that holds the other end of the standard input
"""

from __future__ import annotations

import os
from threading import Thread

ENDED = 1


def watch() -> None:
    """Wait for the end of the standard input, beside what else is done."""
    Thread(target=_wait, daemon=True).start()


def _wait() -> None:
    while os.read(0, 1):
        pass
    os._exit(ENDED)


if __name__ == "__main__":
    from .cli import main

    watch()
    main()
