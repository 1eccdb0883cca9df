"""`meshlab-svbrdf view`: a session and its page, from the first look to the last edit."""

from __future__ import annotations

import contextlib
import signal
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

from ..errors import SvbrdfError
from .picking import warm
from .scene import Scene
from .server import PageServer
from .session import Session

ENDS = ("SIGTERM", "SIGHUP")
"""Signals that end the page as Ctrl+C does: a window that is closed, a machine that goes down."""


@contextlib.contextmanager
def _ended_alike() -> Iterator[None]:
    before = {}
    for name in ENDS:
        with contextlib.suppress(AttributeError, ValueError):  # not here, or not the main thread
            number = getattr(signal, name)
            before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def serve(
    project: Path, port: int, browser: bool, say: Callable[[str], object], ready=lambda page: None
) -> None:
    """Serve a project until it is interrupted. What was not saved then is kept as a script.

    ready : called with the server before it waits for requests
    """
    session = Session(Scene(project))
    Thread(target=warm, args=(session,), daemon=True).start()
    try:
        page = PageServer(session, port)
    except OSError as error:
        raise SvbrdfError(
            f"port {port} cannot be had ({error.strerror}): choose another with --port, or 0"
        ) from None
    with page, _ended_alike():
        say(f"Open {page.address}\n(for this machine alone; Ctrl+C ends it)")
        if browser:
            webbrowser.open(page.address)
        ready(page)
        with contextlib.suppress(KeyboardInterrupt):
            page.serve_forever()
    if session.dirty:
        kept = project.absolute().with_name(f"{project.stem}.unsaved.mlx")
        session.write_script(kept)
        say("What was not saved is kept as a script. To apply it:")
        say(f"meshlab-svbrdf run {project} -o {project} --script {kept}")
