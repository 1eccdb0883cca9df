"""What a page asks of a session: a name, a function, an answer. No sockets in here."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..document.products import plain
from . import maps, picking, shots, wire
from .session import Session

BINARY = "application/octet-stream"


class Refused(Exception):
    """A request that is not answered, with an HTTP status."""

    def __init__(self, message: str, status: int = 403) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class Answer:
    body: bytes
    type: str = BINARY
    headers: dict[str, str] = field(default_factory=dict)

    @classmethod
    def json(cls, value: Any) -> Answer:
        text = json.dumps(plain(value), allow_nan=False, separators=(",", ":"))
        return cls(text.encode(), "application/json")


Given = dict[str, Any]


def _scene(session: Session, given: Given) -> Answer:
    scene = session.scene
    has_diffuse = scene.attribute("diffuse") is not None
    return Answer.json(
        wire.outline(scene)
        | {
            "maps": maps.available(scene),
            "finds": has_diffuse,
            "threshold": session.threshold,
            "gloss": session.by_gloss,
        }
    )


def _map(session: Session, given: Given) -> Answer:
    shown = maps.paint(session.scene, given["name"], int(given.get("frame", 0)))
    return Answer(shown.colors.tobytes(), headers={"X-Legend": json.dumps(shown.legend)})


def _labels(session: Session, given: Given) -> Answer:
    with session.lock:
        labels, revision = session.labels, session.revision
    return Answer(wire.labels(labels), headers={"X-Revision": str(revision)})


def _script(session: Session, given: Given) -> Answer:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "materials.mlx"
        session.write_script(path)
        return Answer(path.read_bytes(), "application/xml")


def _rays(given: Given) -> tuple[np.ndarray, np.ndarray]:
    rays = np.array(given["rays"], float).reshape(-1, 6)
    return rays[:, :3], rays[:, 3:]


def _hits(session: Session, given: Given) -> Answer:
    return Answer.json({"points": picking.hits(session, *_rays(given))})


def _pick(session: Session, given: Given) -> Answer:
    return Answer.json(picking.pick(session, *_rays(given)))


def _split(session: Session, given: Given) -> Answer:
    trace = picking.loop if given.get("through") else picking.hits
    stroke = trace(session, *_rays(given))
    session.split(stroke, int(given.get("cluster", -1)), given["revision"])
    return _state(session, given)


def _state(session: Session, given: Given) -> Answer:
    return Answer.json(session.describe())


def _edit(work: Callable[[Session, Given], Any]) -> Callable[[Session, Given], Answer]:
    def route(session: Session, given: Given) -> Answer:
        said = work(session, given)
        return Answer.json(session.describe() | ({"said": said} if said else {}))

    return route


GET: dict[str, Callable[[Session, Given], Answer]] = {
    "scene": _scene,
    "geometry": lambda s, g: Answer(wire.geometry(s.scene)),
    "pixels": lambda s, g: Answer(wire.pixels(s.scene, int(g["texture"]))),
    "labels": _labels,
    "map": _map,
    "state": _state,
    "script": _script,
    "point": lambda s, g: Answer.json(picking.tell(s, int(g["texel"]))),
    "history": lambda s, g: Answer.json(picking.plot_history(s, int(g["texel"]))),
    "density": lambda s, g: Answer.json(picking.plot_density(s, int(g["cluster"]))),
    "stand": lambda s, g: Answer.json(shots.stand(s.scene, int(g["frame"]))),
    "picture": lambda s, g: Answer(shots.picture(s.scene, int(g["frame"])), "image/jpeg"),
    "preview": lambda s, g: Answer(wire.labels(s.preview(float(g["threshold"])))),
}

POST: dict[str, Callable[[Session, Given], Answer]] = {
    "pick": _pick,
    "hits": _hits,
    "split": _split,
    "merge": _edit(lambda s, g: s.merge([int(k) for k in g["ids"]], g["revision"])),
    "rename": _edit(lambda s, g: s.rename(int(g["id"]), str(g["name"]), g["revision"])),
    "find": _edit(lambda s, g: s.find(float(g["threshold"]), g["revision"])),
    "undo": _edit(lambda s, g: s.undo(g["revision"])),
    "redo": _edit(lambda s, g: s.redo(g["revision"])),
    "save": _edit(lambda s, g: s.save()),
}
