"""What the documentation's pictures are made with: a style, the object rendered, small files."""

from __future__ import annotations

import json
from functools import cached_property
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.document.project import RasterEntry, read_project
from meshlab_svbrdf.filters._comparison import Compared, compare_frames
from meshlab_svbrdf.filters._lights import read_lights
from meshlab_svbrdf.filters._matte import matte
from meshlab_svbrdf.filters._stages import read_lights_found, read_observations
from meshlab_svbrdf.filters.generate_svbrdf_rendering import read_appearance
from meshlab_svbrdf.geometry.camera import Camera
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.rendering.acquisition import AcquisitionRenderer
from meshlab_svbrdf.rendering.paths import framed
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

mpl.use("Agg")
import matplotlib.pyplot as plt  # the backend is chosen first

HERE = Path(__file__).parent
SAMPLE = HERE.parent / "sample_projects" / "totem"
TRUTH = SAMPLE / "ground_truth"
BACK, INK, DIM = "#1d1f21", "#e8e6e3", "#7d8285"
BLUE, ORANGE, GREEN, RED = "#6cb2e0", "#f2a33a", "#8fc97a", "#e5645c"
UNOBSERVED = 118  # sRGB grey of what was not observed
DPI = 100
MOST_BYTES = 150_000

plt.rcParams.update({
    "figure.facecolor": BACK, "axes.facecolor": BACK, "savefig.facecolor": BACK,
    "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.edgecolor": DIM, "grid.color": "#3a3d40", "legend.frameon": False, "font.size": 9,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 9,
})  # fmt: skip


class Scene:
    """A result of the sample project, with its truth."""

    def __init__(self, project: str | Path) -> None:
        self.document = Document.open(project)
        self.mesh = self.document.mesh()
        self.texels = self.document.texels()
        self.lights, self.lights_found = (
            read_lights(self.document),
            read_lights_found(self.document),
        )
        self.held_out = read_project(TRUTH / "views" / "project.mlp").rasters
        self.looks = read_appearance(self.document)

    @cached_property
    def observations(self):
        return read_observations(self.document)

    @cached_property
    def truth(self) -> list[tuple[str, np.ndarray, float]]:
        """Name, direction from the centre and intensity of the true lights."""
        emitters = json.loads((TRUTH / "lights.json").read_text())["emitters"]
        away = [np.array(e["position"]) - self.mesh.center for e in emitters]
        return [
            (e["name"], a / np.linalg.norm(a), float(np.mean(e["phong_intensity"])))
            for e, a in zip(emitters, away, strict=True)
        ]

    def frame(self, label: str):
        """The raster of that label."""
        return next(r for r in self.document.project.rasters if r.label == label)

    def wearing(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        """The object with a texture image (H, W, 3) uint8 or linear float, as 8-bit sRGB."""
        return on_back(*matte(self.mesh, [image]).render(camera, 3))

    def rendered(self, camera: Camera) -> np.ndarray:
        """The object with its lobes under the lights found, as 8-bit sRGB."""
        return on_back(*AcquisitionRenderer(self.mesh, self.looks, self.lights).render(camera, 3))

    def compared(self, views: list[RasterEntry]) -> list[Compared]:
        """Views of the truth beside what the result makes of them."""
        return list(compare_frames(self.document, views, supersampling=3, grey=UNOBSERVED))

    def as_texture(self, values: np.ndarray) -> np.ndarray:
        """Per-texel linear colours (T, 3) as a texture image; grey where NaN."""
        grey = decode(np.full((), UNOBSERVED / 255))
        image = self.texels.to_images(np.where(np.isfinite(values), values, grey))[0]
        return np.nan_to_num(image, nan=float(grey))

    def coloured(self, values: np.ndarray, low: float, high: float, name="viridis") -> np.ndarray:
        """Per-texel numbers (T,) as a texture image through a colour map; grey where NaN."""
        colors = plt.get_cmap(name)(np.clip((values - low) / (high - low), 0, 1))[:, :3]
        return self.as_texture(np.where(np.isfinite(values)[:, None], decode(colors), np.nan))


def on_back(linear: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """A rendering over the pictures' background, 8-bit sRGB."""
    back = decode(np.array(mpl.colors.to_rgb(BACK)))
    return to_srgb8(linear + (1 - coverage[..., None]) * back)


def picture(path: Path) -> np.ndarray:
    """An image file as (H, W, 3) uint8."""
    return read_image(path)[..., :3]


def around(camera: Camera, mesh: Mesh) -> Camera:
    """The part of a view that shows the mesh."""
    return framed([camera], mesh.vertices)[0]


def row_of_images(images: list[np.ndarray], titles: list[str], width: float = 9.0):
    """A figure of images side by side, as high as they need."""
    ratios = [i.shape[1] / i.shape[0] for i in images]
    height = width / sum(ratios) * 0.98
    figure, axes = plt.subplots(
        1, len(images), figsize=(width, height + 0.28), width_ratios=ratios, squeeze=False,
    )  # fmt: skip
    for axis, image, title in zip(axes[0], images, titles, strict=True):
        show(axis, image, title)
    figure.subplots_adjust(0.004, 0.004, 0.996, 1 - 0.28 / (height + 0.28), wspace=0.015)
    return figure


def show(axis, image: np.ndarray, title: str = "", **options) -> None:
    axis.imshow(image, **options)
    axis.set_axis_off()
    axis.set_title(title, pad=5)


def save(figure, name: str) -> None:
    """docs/images/NAME of a figure."""
    buffer = BytesIO()
    figure.savefig(buffer, dpi=DPI)
    plt.close(figure)
    keep(np.asarray(Image.open(buffer).convert("RGB")), name)


def keep(pixels: np.ndarray, name: str, most: int = MOST_BYTES) -> None:
    """docs/images/NAME, a PNG of fewer colours where it would be too large, or a JPEG."""
    image, path = Image.fromarray(pixels), HERE / "images" / name
    if path.suffix == ".jpg":
        image.save(path, quality=88, optimize=True)
    else:
        image.save(path, optimize=True)
        for colors in (256, 128, 64, 32):
            if path.stat().st_size <= most:
                break
            few = image.quantize(colors, dither=Image.Dither.NONE)
            few.save(path, optimize=True)
    print(f"{path.relative_to(HERE.parent)}: {path.stat().st_size / 1000:.0f} kB")
