"""The documentation's pictures, from a run of the sample project.

pip install -e '.[docs]'
python docs/make_pictures.py [--result out/totem.mlp] [NAME ...]

Without --result the sample project is run first, into a folder that goes afterwards.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.patches import Ellipse
from picture_kit import (
    BLUE,
    DIM,
    GREEN,
    ORANGE,
    SAMPLE,
    TRUTH,
    Scene,
    around,
    keep,
    on_back,
    picture,
    plt,
    row_of_images,
    save,
    show,
)  # fmt: skip
from picture_plots import joint_profiles, light_shapes, material_bells, peak_in_time, texel_history

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image
from meshlab_svbrdf.filters._comparison import ERROR_TOP
from meshlab_svbrdf.filters._sphere import marked_map
from meshlab_svbrdf.filters.generate_svbrdf_comparison import small
from meshlab_svbrdf.geometry.harmonics import basis
from meshlab_svbrdf.geometry.visibility import Rays, remap
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.reflectance.directions import directions
from meshlab_svbrdf.reflectance.labels import palette
from meshlab_svbrdf.registration.overlay import draw_overlay, feature_edges
from meshlab_svbrdf.registration.track import register_frames
from meshlab_svbrdf.rendering.environment_lights import (
    Illumination,
    cut_environment,
    together,
    uniform_light,
)
from meshlab_svbrdf.rendering.paths import framed, turntable, upward
from meshlab_svbrdf.rendering.relight import RelitRenderer
from meshlab_svbrdf.rendering.sheet import sheet
from meshlab_svbrdf.samples.luminance import decode
from meshlab_svbrdf.script import run_script

FRAME = "high_045.jpg"


def overview(scene: Scene) -> None:
    """The strip of the README."""
    document, raster, view = scene.document, scene.frame(FRAME), scene.held_out[1]
    camera = raster.camera
    top = [
        (picture(raster.path), "a frame of the video"),
        (scene.wearing(document.map("diffuse", "png")[0], camera), "diffuse colour"),
        (scene.wearing(document.map("materials_shown", "png")[0], camera), "materials"),
        (scene.wearing(document.map("alpha", "png")[0], camera), "shininess α (grey: unobserved)"),
    ]
    figure = plt.figure(figsize=(12, 8.55))
    grid = figure.add_gridspec(
        2, 4, left=0.003, right=0.997, bottom=0.003, top=0.968, wspace=0.012, hspace=0.06
    )
    for k, (image, title) in enumerate(top):
        show(figure.add_subplot(grid[0, k]), image, title)
    show(figure.add_subplot(grid[1, 0]), picture(view.path), "a view that was held out")
    show(figure.add_subplot(grid[1, 1]), scene.rendered(view.camera), "the same view, rendered")
    sphere = marked_map(document.image("environment").astype(float), scene.lights)
    show(figure.add_subplot(grid[1, 2:]), sphere, "environment map, with the lights found")
    save(figure, "totem.jpg")


def registration(scene: Scene) -> None:
    """Frames with the mesh's lines over them; only the first one's camera was given."""
    wanted = {f"high_{k:03d}.jpg" for k in range(0, 120, 2)}
    rasters = [r for r in scene.document.project.rasters if r.label in wanted]
    frames = [picture(raster.path) for raster in rasters]
    mesh = scene.mesh
    found = register_frames(mesh.vertices, mesh.faces, frames, {0: rasters[0].camera})
    edges = feature_edges(mesh.vertices, mesh.faces)
    shown = [0, 13, 27, 41]
    images = [
        draw_overlay(frames[k], found.cameras[k], mesh.vertices, mesh.faces, edges) for k in shown
    ]
    titles = ["the frame that was aligned"] + [
        f"{2 * k} frames on: residual {found.frames[k].residual:.2f} px" for k in shown[1:]
    ]
    save(row_of_images(images, titles), "registration.jpg")


def texels(scene: Scene) -> None:
    """The atlas in normals, some texels in their triangles, the object."""
    t = scene.texels
    atlas = t.to_images((0.5 + 0.5 * t.normal).astype(np.float32), 0.11)[0]
    camera = scene.frame(FRAME).camera.scaled(1.2)
    figure = row_of_images(
        [atlas[::2, ::2], np.ones((480, 480, 3)), scene.wearing(decode(atlas), camera)],
        ["texels: the colour is the normal", "20 × 20 of them, one per pixel centre", ""],
    )
    # Draw the triangles and texel centres of a small window of the atlas
    axis = figure.axes[1]
    axis.clear()
    row, col = 600, 420
    near = (abs(t.row - row) <= 10) & (abs(t.col - col) <= 10)
    height, width = t.sizes[0]
    corners = scene.mesh.uv[np.unique(t.face[near])] * [width, -height] + [0, height]
    for triangle in corners:
        axis.fill(*triangle.T, edgecolor=DIM, facecolor="none", linewidth=0.8)
    colors = 0.5 + 0.5 * t.normal[near]
    axis.scatter(t.col[near] + 0.5, t.row[near] + 0.5, s=16, c=colors)
    axis.set(xlim=(col - 10, col + 10), ylim=(row + 10, row - 10), aspect="equal")
    axis.set_title("20 × 20 of them, one per pixel centre", pad=5)
    axis.set_axis_off()
    save(figure, "texels.png")


def visibility(scene: Scene) -> None:
    """The open share of the hemisphere, and one vertex's visibility in rays and in harmonics."""
    coefficients = scene.document.array("visibility")
    mesh, normals = scene.mesh, scene.mesh.vertex_normals()
    openness = coefficients[:, 0] * np.sqrt(4 * np.pi) / (2 * np.pi)
    corners = openness[mesh.faces[scene.texels.face]]
    grey = np.einsum("tc,tc->t", corners, scene.texels.barycentric).clip(0, 1) ** 2.2
    camera = around(scene.frame(FRAME).camera, scene.mesh)
    images = [scene.wearing(scene.as_texture(np.repeat(grey[:, None], 3, 1)), camera)]

    # Look at the hemisphere of a half-open vertex, its normal in the middle
    towards = camera.center - scene.mesh.center
    v = int(np.argmin(abs(openness - 0.6) + (normals @ towards < 3)))
    n = normals[v]
    a = np.cross(n, [0, 1, 0] if abs(n[1]) < 0.9 else [1, 0, 0])
    a /= np.linalg.norm(a)
    b = np.cross(n, a)
    x, y = np.meshgrid(np.linspace(-1, 1, 400), np.linspace(1, -1, 400))
    radius = np.hypot(x, y)
    theta = np.minimum(radius, 1) * np.pi / 2
    scale = np.sin(theta) / np.maximum(radius, 1e-9)
    omega = x[..., None] * scale[..., None] * a + y[..., None] * scale[..., None] * b
    omega = (omega + np.cos(theta)[..., None] * n).reshape(-1, 3)
    rays = Rays(mesh)
    origin = (mesh.vertices[v] - rays.center + 1e-4 * rays.radius * n)[None].astype(np.float32)
    seen = ~rays.blocked(np.repeat(origin, len(omega), 0), omega)
    smooth = basis(omega) @ coefficients[v]
    for values in (seen.astype(float), np.clip(smooth, 0, 1), remap(smooth)):
        image = np.repeat(values.reshape(x.shape)[..., None], 3, -1)
        image[radius > 1] = (0.114, 0.122, 0.129)
        images.append((255 * image).astype(np.uint8))
    titles = [
        "open share", "one vertex: rays", "six bands", "remapped",
    ]  # fmt: skip
    save(row_of_images(images, titles), "visibility.png")


def samples(scene: Scene) -> None:
    """A frame, the quality of its samples, and in how many frames each texel is seen."""
    raster = scene.frame(FRAME)
    used = [f["label"] for f in scene.document.json("frames")["frames"] if "samples" in f]
    index = used.index(FRAME)
    quality = np.full(len(scene.texels), np.nan)
    for block in scene.observations.store.blocks():
        owner = np.repeat(np.arange(block.first, block.stop), np.diff(block.offsets))
        here = block.frame == index
        quality[owner[here]] = (block.quality[here] & 127) / 127
    frames = scene.document.attribute("frames").astype(float)
    top = float(np.quantile(frames, 0.99))
    images = [
        picture(raster.path),
        scene.wearing(scene.coloured(quality, 0, 1), raster.camera),
        scene.wearing(scene.coloured(frames, 0, top), raster.camera),
    ]
    titles = ["a frame", "quality of its samples, 0 to 1", f"samples per texel, 0 to {top:.0f}"]
    save(row_of_images(images, titles, 8), "samples.png")


def environment(scene: Scene) -> None:
    """The map with the true lights, and where the object had mirrors."""
    document = scene.document
    radiance, weight = (document.array(f"environment_{w}") for w in ("radiance", "weight"))
    figure, axes = plt.subplots(1, 2, figsize=(9, 2.55))
    top = np.quantile(radiance[weight > 0], 0.999)
    show(axes[0], radiance, "excess over the threshold; ○ true lights", cmap="gray", vmax=top)
    height = len(radiance)
    for _, d, _ in scene.truth:
        phi, theta = np.arctan2(d[0], -d[2]) % (2 * np.pi), np.arccos(d[1])
        place = phi / np.pi * height - 0.5, theta / np.pi * height - 0.5
        axes[0].plot(*place, "o", markersize=15, markerfacecolor="none", color=ORANGE)
    show(axes[1], np.log10(np.maximum(weight, 0.1)), "samples mirrored there (log Σ q·V)")
    figure.subplots_adjust(0.004, 0.004, 0.996, 0.9, wspace=0.02)
    save(figure, "environment.png")


def diffuse(scene: Scene) -> None:
    """Mean, statistical D, final D and the truth."""
    document = scene.document
    camera = around(scene.frame("high_040.jpg").camera.scaled(1.2), scene.mesh)
    names = ("mean_color", "diffuse", "final_diffuse")
    images = [scene.wearing(scene.as_texture(document.attribute(n) / 100), camera) for n in names]
    images.append(scene.wearing(read_exr(TRUTH / "diffuse_shaded.exr"), camera))
    titles = ["mean of the samples", "D, statistical", "D, after the joint fit", "truth"]
    save(row_of_images(images, titles), "diffuse.png")


def lights(scene: Scene) -> None:
    """Each light's blob with its ellipse, before and after the fit."""
    figure, axes = plt.subplots(1, len(scene.lights_found), figsize=(9, 3.3))
    for axis, light in zip(np.atleast_1d(axes), scene.lights_found, strict=True):
        image, extent, place = light_shapes(scene, light)
        axis.imshow(image, extent=extent, cmap="gray", origin="lower")
        values, vectors = np.linalg.eigh(np.degrees(np.degrees(light.covariance)))
        angle = np.degrees(np.arctan2(*vectors[::-1, 1]))
        for sigmas, style in ((1, "-"), (2.5, ":")):
            size = 2 * sigmas * np.sqrt(values[::-1])
            axis.add_patch(Ellipse((0, 0), *size, angle=angle, fill=False, ls=style, color=BLUE))
        axis.plot(0, 0, "+", color=BLUE, label="centroid, 1σ and 2.5σ")
        refined = [place(lamp.direction) for lamp in scene.lights]
        true = [(name, place(d)) for name, d, _ in scene.truth]
        axis.plot(*min(refined, key=np.linalg.norm), "x", color=GREEN, label="after the joint fit")
        name, where = min(true, key=lambda each: np.linalg.norm(each[1]))
        axis.plot(*where, "o", markersize=11, markerfacecolor="none", color=ORANGE, label="truth")
        axis.set(title=f"{name} light", xlabel="degrees", xlim=extent[:2], ylim=extent[2:])
    figure.legend(*axis.get_legend_handles_labels(), loc="lower center", ncols=3)
    figure.subplots_adjust(0.05, 0.23, 0.99, 0.93)
    save(figure, "lights.png")


def texel_specular(scene: Scene) -> None:
    """One peak, and α of the texels."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), width_ratios=(1.8, 1))
    peak_in_time(scene, left)
    alpha = scene.document.attribute("alpha").astype(float)
    image = scene.coloured(np.log10(alpha), 0.5, 2.5)
    show(right, scene.wearing(image, scene.frame(FRAME).camera), "α of single texels")
    bar = plt.cm.ScalarMappable(plt.Normalize(0.5, 2.5), "viridis")
    colorbar = figure.colorbar(bar, ax=right, fraction=0.04, ticks=np.log10([5, 20, 60, 200]))
    colorbar.ax.set_yticklabels(["5", "20", "60", "200"])
    figure.subplots_adjust(0.06, 0.12, 0.96, 0.92, wspace=0.05)
    save(figure, "texel_specular.png")


def materials(scene: Scene) -> None:
    """The clusters on the object and in the atlas, beside the true materials."""
    camera = around(scene.frame(FRAME).camera, scene.mesh)
    shown = scene.document.map("materials_shown", "png")[0]
    ids = read_image(TRUTH / "material_id.png")
    labels = scene.document.map("material", "png")[0]
    grey = np.full((256, 3), 60, np.uint8)
    colors, step = palette(255), labels.shape[0] // ids.shape[0]
    for material in np.unique(ids[ids < 255]):
        own = labels[::step, ::step][ids == material]
        grey[material] = colors[np.bincount(own[own < 255]).argmax()]
    truth = grey[ids]
    images = [scene.wearing(shown, camera), shown[::2, ::2], scene.wearing(truth, camera)]
    found = len(scene.document.json("materials")["materials"])
    titles = [f"{found} clusters", "in the atlas", "the 3 true materials"]
    save(row_of_images(images, titles, 8), "materials.png")


def rendering(scene: Scene) -> None:
    """A held-out view, its rendering, and where they differ."""
    (found,) = scene.compared([scene.held_out[3]])
    *_, made, true, off = found.panels
    top = f"difference, 0 (black) to {ERROR_TOP} of 255"
    titles = ["held-out view", f"rendered: {found.psnr:.1f} dB", top]
    save(row_of_images([true.image, made.image, off.image], titles, 8), "rendering.png")


def compared(scene: Scene) -> None:
    """The sheet of `meshlab-svbrdf compare`, of two held-out views."""
    found = scene.compared([scene.held_out[1], scene.held_out[3]])
    image = sheet([[small(panel, 260) for panel in each.panels] for each in found])
    keep(image, "comparison.jpg")


def walk(scene: Scene) -> None:
    """A turntable of six frames."""
    cameras = [raster.camera for raster in scene.document.project.rasters]
    center, radius = scene.mesh.center, scene.mesh.radius
    ring = framed(turntable(cameras[0], center, radius, upward(cameras), 6), scene.mesh.vertices, 6)
    save(row_of_images([scene.rendered(camera) for camera in ring], [""] * 6), "turntable.jpg")


def report(scene: Scene) -> None:
    """The first part of the sample's report, as a browser shows it."""
    from playwright.sync_api import sync_playwright

    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print("report.jpg: left out, there is no Chromium on the PATH")
        return
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        page, shot = Path(folder) / "totem.html", Path(folder) / "shot.png"
        scene.document.apply("generate_svbrdf_report", file=page)
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        view = opened.new_page(viewport={"width": 1000, "height": 1500})
        view.goto(page.as_uri())
        view.screenshot(path=shot)
        opened.close()
        keep(read_image(shot)[..., :3], "report.jpg")


def threshold(scene: Scene) -> None:
    """A texel's luminance over the frames."""
    figure, axis = plt.subplots(figsize=(9, 3.4))
    texel_history(scene, axis)
    figure.subplots_adjust(0.055, 0.14, 0.99, 0.97)
    save(figure, "threshold.png")


def material_specular(scene: Scene) -> None:
    """The paper's bells and the joint fit's profiles."""
    for name, draw in (("paper", material_bells), ("joint", joint_profiles)):
        figure, axis = plt.subplots(figsize=(9, 3.4))
        draw(scene, axis)
        axis.grid(alpha=0.4)
        figure.subplots_adjust(0.07, 0.15, 0.99, 0.93)
        save(figure, f"material_specular_{name}.png")


def albedo(scene: Scene) -> None:
    """D, and what is left of it without the light."""
    camera = around(scene.held_out[3].camera, scene.mesh).scaled(1.5)
    shown = [scene.wearing(scene.document.map(name)[0], camera) for name in ("diffuse", "albedo")]
    save(row_of_images(shown, ["diffuse colour, as it was lit", "albedo"], 8), "albedo.png")


def relighting(scene: Scene) -> None:
    """A view in its own light, under one lamp, and under a sky with a low sun."""
    camera = around(scene.held_out[3].camera, scene.mesh).scaled(1.5)
    looks = [replace(scene.looks[0], diffuse=scene.document.map("albedo")[0])]
    lamp = Illumination(
        np.array([[-0.48, 0.6, 0.64]]), np.zeros(1), np.full((1, 3), 1.6), np.zeros(1, bool)
    )
    rays = directions(64)
    sun = np.exp(600 * (rays @ (np.array([0.8, 0.35, 0.49]) / 1.0013) - 1))
    up = np.clip(rays[..., 1], 0, 1)[..., None]
    sky = up**0.3 * [0.35, 0.5, 0.8] + sun[..., None] * [900.0, 620.0, 330.0]
    images = [scene.rendered(camera)]
    for light in (together([lamp, uniform_light(np.full(3, 0.05))]), cut_environment(sky)):
        images.append(on_back(*RelitRenderer(scene.mesh, looks, light).render(camera, 3)))
    titles = ["as it was lit", "one lamp", "a sky with a low sun"]
    save(row_of_images(images, titles, 9), "relighting.png")


PICTURES = (
    overview, registration, texels, visibility, samples, threshold, environment, diffuse, lights,
    texel_specular, materials, material_specular, albedo, relighting, rendering, compared, walk,
    report,
)  # fmt: skip


@contextmanager
def sample_result() -> Iterator[Path]:
    """A run of the sample project on all frames, with all that pictures show."""
    with tempfile.TemporaryDirectory() as folder:
        document = Document.open(SAMPLE / "totem.mlp", folder)
        for outcome in run_script(document, chain(preset="full")):
            print(f"{outcome.name}: {outcome.message}")
        for name in ("compute_svbrdf_texel_specular", "compute_svbrdf_albedo"):
            print(f"{name}: {document.apply(name).message}")
        document.save()
        yield document.path


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = [draw.__name__ for draw in PICTURES]
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    parser.add_argument("--result", type=Path, help="a result of the sample project")
    given = parser.parse_args()
    if unknown := set(given.names) - set(known):
        parser.error(f"no such picture: {', '.join(sorted(unknown))}")
    with nullcontext(given.result) if given.result else sample_result() as project:
        scene = Scene(project)
        for draw in PICTURES:
            if not given.names or draw.__name__ in given.names:
                draw(scene)


if __name__ == "__main__":
    main()
