"""`meshlab-svbrdf view`: a session and its page, from the first look to the last edit."""

from __future__ import annotations

import contextlib
import webbrowser
from collections.abc import Callable
from pathlib import Path
from threading import Thread

from ..errors import SvbrdfError
from .picking import warm
from .scene import Scene
from .server import PageServer
from .session import Session


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
    with page:
        say(f"Open {page.address}\n(for this machine alone; Ctrl+C ends it)")
        if browser:
            webbrowser.open(page.address)
        ready(page)
        with contextlib.suppress(KeyboardInterrupt):
            page.serve_forever()
    if session.dirty:
        kept = project.absolute().with_name(f"{project.stem}.unsaved.mlx")
        session.write_script(kept)
        say(f"What was not saved is kept in {kept.name}: `meshlab-svbrdf run --script` applies it.")
