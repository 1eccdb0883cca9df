"""The sample project's files agree with the paper's equation, by rays cast in the plainest way."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from meshlab_svbrdf.document.exposure import read_exposure
from meshlab_svbrdf.document.images import read_exr, read_frame, read_image, read_mask
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import Project, read_project
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.mesh import Mesh
from sample_projects.make_totem import TINY, Options, Totem, make_scene, make_totem, placed
from sample_projects.procedural.capture import picture
from sample_projects.procedural.paint import encode_srgb

FEW = replace(TINY, frames=8, masks=True, noise=0.0)
VARIANTS = {
    "near": FEW,
    "map coordinates": replace(FEW, world=placed((1e6, 4e5, 300.0), scale=25.0)),
    "far, odd camera": replace(
        FEW,
        near=False,
        orbits=1,
        principal=(7.25, -4.5),
        aspect=1.1,
        world=placed((3.0, -2.0, 5.0), scale=0.2),
        layer_matrix=True,
        exposure=0.3,
        exif=True,
    ),
}


@pytest.fixture(scope="module", params=VARIANTS, ids=lambda name: name.replace(" ", "_"))
def made(request, tmp_path_factory) -> tuple[Options, Totem, Project, Mesh]:
    options = VARIANTS[request.param]
    totem = make_totem(tmp_path_factory.mktemp("totem"), options)
    project = read_project(totem.path)
    (layer,) = project.meshes
    return options, totem, project, read_mesh(layer.path).mesh.transformed(layer.matrix)


def first_hits(
    mesh: Mesh, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Möller and Trumbore against every triangle: face (N,), -1 where none, barycentrics (N, 3)."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    faces, weights = np.full(len(origins), -1), np.zeros((len(origins), 3))
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        p = np.cross(d, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / np.einsum("ij,ij->i", p, b - a)
            q = np.cross(o - a, b - a)
            u = np.einsum("ij,ij->i", o - a, p) * scale
            v = q @ d * scale
            t = np.einsum("ij,ij->i", q, c - a) * scale
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        if hit.any():
            faces[i] = np.argmin(np.where(hit, t, np.inf))
            u, v = u[faces[i]], v[faces[i]]
            weights[i] = 1 - u - v, u, v
    return faces, weights


def linear(code: np.ndarray) -> np.ndarray:
    x = code / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def lit(truth: Path, mesh: Mesh, points: np.ndarray, normals: np.ndarray):
    """For each light of lights.json: direction to it, intensity there, and whether it is seen."""
    for light in json.loads((truth / "lights.json").read_text())["emitters"]:
        if light["position"] is None:
            toward, falloff = np.broadcast_to(light["direction"], points.shape), 1.0
        else:
            offset = np.array(light["position"]) - points
            d = np.linalg.norm(offset, axis=1)
            toward, falloff = offset / d[:, None], (light["distance"] * mesh.radius / d) ** 2
        start = points + 2e-3 * mesh.radius * normals
        seen = first_hits(mesh, start, toward)[0] < 0
        seen &= (normals * toward).sum(1) > 0
        yield toward, light["phong_intensity"][0] * falloff * seen


def test_the_project_holds_the_scan_that_was_seen(made):
    options, totem, project, mesh = made
    assert [(r.label, r.sequence) for r in project.rasters] == [
        (f.label, f.folder) for f in totem.frames
    ]
    assert len({r.sequence for r in project.rasters}) == options.orbits
    np.testing.assert_array_equal(mesh.faces, totem.mesh.faces)
    reach = np.abs(mesh.vertices).max()
    np.testing.assert_allclose(mesh.vertices, totem.mesh.vertices, rtol=0, atol=1e-7 * reach)
    np.testing.assert_array_equal(mesh.uv, totem.mesh.uv)
    for raster, frame in zip(project.rasters, totem.frames, strict=True):
        points = mesh.vertices[::50]
        expected = frame.camera.project(points)
        np.testing.assert_allclose(raster.camera.project(points), expected, rtol=0, atol=1e-3)


def test_masks_are_the_meshs_silhouettes(made):
    _, _, project, mesh = made
    for raster in project.rasters:
        camera = raster.camera
        mask = read_mask(raster.mask, size=(camera.width, camera.height)).astype(np.uint8)
        pixels = camera.project(mesh.vertices)[mesh.faces, :2]
        drawn = np.zeros_like(mask)
        for triangle in np.round(pixels * 16).astype(np.int32):
            cv2.fillConvexPoly(drawn, triangle, 1, shift=4)
        kernel = np.ones((3, 3), np.uint8)
        assert mask.sum() > 0.1 * mask.size
        # Filled polygons are half a pixel fat: the sharp corners of the handles' holes close
        assert (mask < cv2.erode(drawn, kernel, borderValue=0)).sum() < 6
        assert (mask <= cv2.dilate(drawn, kernel)).all()


def test_views_obey_the_papers_equation(made):
    """Eq. 1 from the truth's files, at pixel centres, against the held-out view's code values."""
    _, totem, _, mesh = made
    truth = totem.path.parent / "ground_truth"
    (raster,) = read_project(truth / "views" / "project.mlp").rasters
    image, camera = read_frame(raster.path), raster.camera

    # Cast rays where the picture is smooth: off silhouettes, patterns and shadows' edges
    kernel = np.ones((5, 5), np.uint8)
    contrast = (cv2.dilate(image, kernel).astype(int) - cv2.erode(image, kernel)).max(-1)
    backdrop = (image == image[0, 0]).all(-1).astype(np.uint8)
    inside = np.argwhere((cv2.dilate(backdrop, kernel) == 0) & (contrast < 25))
    rows, cols = np.random.default_rng(0).choice(inside, 250, replace=False).T
    rays = np.stack(
        [(cols - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, 1 + 0 * rows], -1
    )
    rays = rays @ camera.R / np.linalg.norm(rays, axis=1, keepdims=True)
    face, weights = first_hits(mesh, np.tile(camera.center, (len(rays), 1)), rays)
    assert (face >= 0).all()
    mix = lambda corners: (weights[..., None] * corners[face]).sum(1)  # noqa: E731
    points, normals = mix(mesh.vertices[mesh.faces]), mix(mesh.vertex_normals()[mesh.faces])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    # Read materials and albedo off the nearest texel, close enough where the picture is smooth
    albedo, identity = read_image(truth / "albedo.png"), read_image(truth / "material_id.png")
    size = len(albedo)
    u, v = mix(mesh.uv).T
    row, col = ((1 - v) * size).astype(int), (u * size).astype(int)
    color = linear(albedo[row, col])
    materials = json.loads((truth / "materials.json").read_text())["materials"]
    rho_s = np.array([m["rho_s"] for m in materials])[identity[row, col]]
    alpha = np.array([m["alpha"] for m in materials])[identity[row, col]]

    view = -rays
    mirror = 2 * (normals * view).sum(1)[:, None] * normals - view
    record = json.loads((truth / "lights.json").read_text())
    expected = np.array(record["ambient_radiance"]) * color
    for toward, intensity in lit(truth, mesh, points, normals):
        lobe = rho_s * np.maximum((toward * mirror).sum(1), 0) ** alpha
        diffuse = np.maximum((toward * normals).sum(1), 0)[:, None] * color
        expected = expected + intensity[:, None] * (diffuse + lobe[:, None])

    error = np.abs(np.minimum(expected, 1) - linear(image[rows, cols])).max(1)
    assert np.median(error) < 0.006
    assert np.quantile(error, 0.95) < 0.03


def test_shaded_truth_is_albedo_times_irradiance(made):
    _, totem, _, mesh = made
    truth = totem.path.parent / "ground_truth"
    shaded = read_exr(truth / "diffuse_shaded.exr")
    size = len(shaded)
    mask = cv2.resize(
        read_image(truth / "texel_mask.png"), (size, size), interpolation=cv2.INTER_AREA
    )
    rows, cols = np.random.default_rng(1).choice(np.argwhere(mask == 255), 120, replace=False).T

    # Find each texel's point by rays through the UV plane
    flat = Mesh(
        np.pad(mesh.uv.reshape(-1, 2), ((0, 0), (0, 1))),
        np.arange(mesh.uv.size // 2).reshape(-1, 3),
    )
    above = np.stack([(cols + 0.5) / size, 1 - (rows + 0.5) / size, 1 + 0 * rows], -1)
    face, weights = first_hits(flat, above, np.tile([0.0, 0, -1], (len(above), 1)))
    assert (face >= 0).all()
    points = (weights[..., None] * mesh.vertices[mesh.faces[face]]).sum(1)
    normals = (weights[..., None] * mesh.vertex_normals()[mesh.faces[face]]).sum(1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    albedo = cv2.resize(
        linear(read_image(truth / "albedo.png")), (size, size), interpolation=cv2.INTER_AREA
    )
    total = np.full(
        len(points), json.loads((truth / "lights.json").read_text())["ambient_radiance"][0]
    )
    for toward, intensity in lit(truth, mesh, points, normals):
        total += intensity * np.maximum((toward * normals).sum(1), 0)
    error = np.abs(total[:, None] * albedo[rows, cols] / shaded[rows, cols] - 1).max(1)
    assert np.median(error) < 0.04
    assert np.quantile(error, 0.8) < 0.12


def test_exposures_are_in_exif_and_in_the_pixels(made):
    options, totem, project, _ = made
    read = [read_exposure(raster.path) for raster in project.rasters]
    if not options.exif:
        assert read == [None] * len(project.rasters)
        return
    true = json.loads((totem.path.parent / "ground_truth" / "frames.json").read_text())["frames"]
    exposure = np.array([frame["exposure"] for frame in true])
    assert [frame["label"] for frame in true] == [raster.label for raster in project.rasters]
    assert exposure.max() / exposure.min() > 1.2
    np.testing.assert_allclose(np.array(read) / read[0], exposure / exposure[0], rtol=1e-3)
    corner = [linear(read_frame(r.path)[:4, :4]).mean() for r in project.rasters]
    np.testing.assert_allclose(np.array(corner) / corner[0], exposure / exposure[0], rtol=0.02)


def test_few_pixels_are_clipped(made):
    _, _, project, _ = made
    clipped = [
        (read_frame(r.path)[read_mask(r.mask)] >= 254).any(-1).mean() for r in project.rasters
    ]
    assert 0 < np.mean(clipped) < 0.02


def test_equal_options_give_equal_bytes(tmp_path):
    options = replace(TINY, frames=2, exif=True, exposure=0.2)
    one, two = (make_totem(tmp_path / name, options).path.parent for name in "ab")
    files = sorted(p.relative_to(one) for p in one.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(two) for p in two.rglob("*") if p.is_file())
    for file in files:
        assert (one / file).read_bytes() == (two / file).read_bytes(), file
    other = make_totem(tmp_path / "c", replace(options, seed=1)).path.parent
    frame = Path("low") / "low_000.jpg"
    assert (one / frame).read_bytes() != (other / frame).read_bytes()


def test_a_scan_may_lack_texture_coordinates(tmp_path):
    totem = make_totem(tmp_path, replace(TINY, frames=2, uv=False, views=0))
    assert read_mesh(totem.path.parent / "totem.ply").mesh.uv is None


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(DocumentError, match="is not empty"):
        make_totem(tmp_path, TINY)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_the_committed_sample_is_what_the_recipe_makes():
    committed = Path(__file__).parents[2] / "sample_projects" / "totem"
    scene, _, orbits, _ = make_scene(Options())
    mesh = read_mesh(committed / "totem.ply").mesh
    np.testing.assert_array_equal(mesh.faces, scene.surface.mesh.faces)
    np.testing.assert_array_equal(mesh.vertices, scene.surface.mesh.vertices)
    lights = json.loads((committed / "ground_truth" / "lights.json").read_text())["emitters"]
    for light, made in zip(lights, scene.lights, strict=True):
        np.testing.assert_allclose(light["position"], made.direction * made.distance, rtol=1e-6)
        np.testing.assert_allclose(light["phong_intensity"], made.intensity, rtol=1e-6)

    project = read_project(committed / "totem.mlp")
    assert len(project.rasters) == Options.frames
    raster = project.rasters[0]
    image, _ = picture(scene, orbits[0][0], 3, np.random.default_rng(0))
    difference = np.abs(255 * encode_srgb(image) - read_frame(raster.path)).mean()
    assert difference < 1.5  # sensor noise of one code value, and JPEG
    size = sum(file.stat().st_size for file in committed.rglob("*") if file.is_file())
    assert size < 6e6
