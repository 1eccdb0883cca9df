"""What `meshlab-svbrdf export` does: the albedo, if need be, and then the files."""

from __future__ import annotations

from pathlib import Path

from .commands import _friendly, _stages
from .commands_show import _divide_light, _finished

EXPORT = "generate_svbrdf_export"


def export(
    project: Path, output: Path, *, formats: str, shaded: bool, lights: Path | None, scale: float,
    unobserved: str, jpeg: bool, as_json: bool,
) -> None:  # fmt: skip
    """Write the object for other programs; without lamps its colour can only be the shaded one."""
    with _friendly():
        document = _finished(project, "export")
        shaded = shaded or not document.json("lights")["lights"]
        parameters = {
            "folder": str(output.absolute()),
            "formats": formats,
            "color": "diffuse" if shaded else "albedo",
            "lights": "" if lights is None else str(lights.absolute()),
            "scale": scale,
            "unobserved": unobserved,
            "color_images": "jpeg" if jpeg else "png",
        }
        with _stages(as_json) as (say, show):
            if not shaded:
                _divide_light(document, say, show, {})
            say(document.apply(EXPORT, False, show("export"), **parameters))
