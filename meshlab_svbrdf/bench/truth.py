"""What a perfect run on the workload would find, in files beside its frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ..document.images import write_exr, write_png
from ..document.project import new_project, write_project
from ..geometry.texels import Texels
from .scene import AMBIENT, LAMPS, MATERIALS, BenchScene
from .walk import FAR, look

VIEWS = ((0.2, 0.55), (1.7, 0.1), (3.3, 0.8), (4.9, 0.3))  # that no frame has: azimuth, elevation


def write_truth(folder: Path, scene: BenchScene, texels: Texels) -> None:
    """Write D as an image, materials and lamps (lights.json last: it tells that all is there)."""
    folder.mkdir(exist_ok=True)
    D, kind = scene.truth(texels)
    write_exr(folder / "diffuse_shaded.exr", texels.to_images(D.astype(np.float32))[0])
    write_png(folder / "material_id.png", texels.to_images(kind.astype(np.uint8), 255)[0])
    materials = [
        {"id": index, "name": name, "rho_s": rho_s, "alpha": alpha}
        for index, (name, rho_s, alpha) in enumerate(MATERIALS)
    ]
    _write_json(folder / "materials.json", {"bsdf": "phong", "materials": materials})
    lamps = [
        {"position": place.tolist(), "intensity": float(intensity)}
        for place, intensity in zip(scene.lamps[:, :3], LAMPS[:, 3], strict=True)
    ]
    _write_json(folder / "lights.json", {"emitters": lamps, "ambient_radiance": AMBIENT})


def write_views(path: Path, scene: BenchScene, mesh: Path, size: tuple[int, int]) -> None:
    """Render views without noise, and write their project last; size : (width, height)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    project = new_project()
    project.add_mesh("bench", mesh)
    for index, (azimuth, elevation) in enumerate(VIEWS):
        camera = look(azimuth, elevation, 1.05 * FAR, *size, scene.reach)
        image = path.parent / f"view_{index:02d}.png"
        write_png(image, scene.frame(camera, index, noise=False))
        project.add_raster(image.name, image, camera)
    write_project(project, path)


def _write_json(path: Path, value: dict) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
