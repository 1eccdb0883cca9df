"""How long the page of `meshlab-svbrdf view` lets one wait, on a large object.

The object is the performance workload's. Answers are asked for as the page asks, over HTTP; where
there is a Chromium, also from the click to the picture, with the browser's own drawing in software.
"""

from __future__ import annotations

import http.client
import json
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import run_script
from meshlab_svbrdf.viewing.picking import warm
from meshlab_svbrdf.viewing.scene import Scene
from meshlab_svbrdf.viewing.server import HOST, PageServer
from meshlab_svbrdf.viewing.session import Session

from .ledger import Row, Task
from .solve import TEXTURE
from .tables import Table

PART = "page"
HOW = {
    "asked": "asked over HTTP",
    "clicked": "in Chromium, from the click on, drawn without a graphics card",
}
FRAMES, TEXELS = 120, 1200  # of the workload, at most; texels along a side: a million
TIMES = 20
WAIT = {"pick": 0.15, "split": 1.0}
"""Seconds that answers may take."""
READY = "body[data-ready]"
Took = dict[str, list[tuple[float, float]]]
CLICK = """async ([x, y, watched]) => {
    const view = document.getElementById("view"), seen = document.querySelector(watched);
    const at = { clientX: x, clientY: y, pointerId: 1, button: 0, bubbles: true };
    view.setPointerCapture = () => {};
    const began = performance.now();
    const shown = new Promise((done) => new MutationObserver((_, own) => {
        own.disconnect();
        const since = () => performance.now() - began, answered = since();
        const drawn = () => done([answered, since()]);
        requestAnimationFrame(() => requestAnimationFrame(drawn));
    }).observe(seen, { childList: true, subtree: true, characterData: true }));
    for (const kind of ["pointerdown", "pointerup"]) view.dispatchEvent(new PointerEvent(kind, at));
    return shown;
}"""


def tasks(frames: int, texture: int, cache: Path | None) -> tuple[list[Task], list[str]]:
    """What is measured, and what cannot be.

    frames, texture : of the workload; cache : keeps its frames; None: the user's cache
    """
    about = f"{frames} frames, {texture} texels"
    lacking = why_no_browser()
    notes = [f"{PART}: Chromium left out, {lacking}"] if lacking else []
    make = partial(_measured, frames, texture, cache, not lacking)
    return [Task(PART, "workload", f"{texture}×{texture}", about, make)], notes


def why_no_browser() -> str:
    if find_spec("playwright") is None:
        return "Playwright's Python package is not there"
    return "" if _chromium() else "it is not on the PATH"


def tables(rows: Sequence[Row]) -> list[Table]:
    made = []
    for row in rows:
        for how in HOW if "error" not in row else ():
            cells = [_cells(name, took) for name, took in row.get(how, {}).items()]
            title = f"{row['texels']:,} texels, {row['triangles']:,} triangles: {HOW[how]}"
            heads = ["what", "times", "ms, middle", "ms, worst", "CPU ms, middle", "ms allowed"]
            made += [Table(title, heads, cells)] if cells else []
    return made


def _cells(name: str, took: Sequence[Sequence[float]]) -> list[str]:
    wall, cpu = 1000 * np.array(took, float).T
    known = np.isfinite(cpu).all()
    limit = WAIT.get(name.partition(",")[0])
    return [
        name, f"{len(took)}", f"{np.median(wall):.0f}", f"{wall.max():.0f}",
        f"{np.median(cpu):.0f}" if known else "–", "" if limit is None else f"{1000 * limit:.0f}",
    ]  # fmt: skip


def _measured(frames: int, texture: int, cache: Path | None, browser: bool, folder: Path) -> Row:
    """A result on the workload, and how long a page of it lets wait."""
    workload = make_workload(cache, frames, Options())
    document = Document.open(workload.first(frames), folder)
    for _ in run_script(document, chain(settings={TEXTURE: texture})):
        pass
    document.save()
    return measure(document.path, browser)


def measure(project: Path, browser: bool) -> Row:
    """Seconds of everything that a page on a project asks."""
    began = _now()
    session = Session(Scene(project))
    took = {"opening": [_since(began)]}
    began = _now()
    warm(session)
    took["what is made meanwhile"] = [_since(began)]
    texels, mesh = session.scene.texels, session.scene.mesh
    row: Row = {"texels": len(texels), "triangles": len(mesh.faces)}
    if browser:
        row["clicked"] = _clicked(session)
    return row | {"asked": took | _asked(session)}


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _since(began: tuple[float, float]) -> tuple[float, float]:
    """Seconds, and CPU seconds: what counts on a machine that does other things, too."""
    return time.perf_counter() - began[0], time.process_time() - began[1]


@contextmanager
def serving(session: Session) -> Iterator[PageServer]:
    """The page, served from a thread of its own."""
    with PageServer(session) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def _asked(session: Session) -> Took:
    took: Took = {}
    with (
        serving(session) as server,
        closing(http.client.HTTPConnection(HOST, server.server_port)) as line,
    ):
        headers = {"X-Svbrdf": "1", "Cookie": f"{server.cookie}={server.token}"}

        def ask(name: str, path: str, given: dict[str, Any] | None = None) -> Any:
            if given is not None:
                given = {"revision": session.revision} | given
            began = _now()
            method = "GET" if given is None else "POST"
            body = None if given is None else json.dumps(given)
            line.request(method, f"/api/{path}", body, headers)
            answer = line.getresponse()
            body = answer.read()
            name += "" if answer.status == 200 else ", refused"
            took.setdefault(name, []).append(_since(began))
            if answer.status != 200:
                return None
            told = answer.headers["Content-Type"] == "application/json"
            return json.loads(body) if told else body

        ids = [cluster["id"] for cluster in session.clusters()]
        for ray in _rays_at_texels(session, TIMES):
            found = ask("pick", "pick", {"rays": ray})
            ask("plot of the frames", f"history?texel={found['texel']}")
            if found["cluster"] >= 0:
                ask("density", f"density?cluster={found['cluster']}")
        for threshold in np.linspace(4, 20, TIMES // 2):
            ask("preview of a threshold", f"preview?threshold={threshold}")
        for through in (False, True):
            for height in np.linspace(-0.6, 0.6, TIMES):
                rays = _rays_across(session, float(height))
                name = "split, through the object" if through else "split, over the front"
                if ask(name, "split", {"rays": rays, "through": through}):
                    ask("labels", "labels")
                    ask("undo", "undo", {})
        for _ in range(TIMES // 2):
            ask("merge", "merge", {"ids": ids[:2]})
            ask("undo", "undo", {})
            ask("redo", "redo", {})
            ask("undo", "undo", {})
        for name in ("samples", "frame"):
            ask(f"map, {name}", f"map?name={name}&frame=5")
        ask("merge", "merge", {"ids": ids[:2]})
        ask("save", "save", {})
        ask("find anew", "find", {"threshold": session.threshold})
    return took


def _clicked(session: Session) -> Took:
    from playwright.sync_api import sync_playwright

    took: Took = {}
    with serving(session) as server, sync_playwright() as player:
        began = time.perf_counter()
        browser = player.chromium.launch(executable_path=_chromium(), args=[
            "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
        ])  # fmt: skip
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(server.address)
        page.wait_for_selector(READY)
        took["opening the page"] = [(time.perf_counter() - began, np.nan)]
        rng = np.random.default_rng(0)
        for x, y in rng.uniform([380, 330], [520, 470], (TIMES, 2)):
            answered, drawn = page.evaluate(CLICK, [x, y, "#numbers"])
            took.setdefault("pick, its numbers", []).append((answered / 1000, np.nan))
            took.setdefault("the picture after it", []).append((drawn / 1000, np.nan))
        browser.close()
    return took


def _rays_at_texels(session: Session, count: int) -> list[list[float]]:
    """From outside, along the normals of some texels."""
    scene, rng = session.scene, np.random.default_rng(1)
    chosen = rng.choice(np.flatnonzero(session.labels >= 0), count, replace=False)
    normal = scene.texels.normal[chosen].astype(float)
    place = scene.texels.position[chosen] + scene.texels.center
    return np.hstack([place + 3 * scene.texels.radius * normal, -normal]).tolist()


def _rays_across(session: Session, height: float, points: int = 200) -> list[list[float]]:
    """A hand's stroke from beyond the object to beyond it, at a height in radii, seen from +Z."""
    texels = session.scene.texels
    eye = texels.center + 4 * texels.radius * np.array([0, 0, 1])
    x = np.linspace(-1.2, 1.2, points)
    aim = texels.center + texels.radius * np.stack([x, np.full(points, height), 0 * x], 1)
    return np.hstack([np.broadcast_to(eye, aim.shape), aim - eye]).tolist()


def _chromium() -> str | None:
    return shutil.which("chromium") or shutil.which("chromium-browser")
