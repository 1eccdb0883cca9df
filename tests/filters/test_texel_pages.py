"""compute_svbrdf_texels, compute_svbrdf_visibility and transfer_svbrdf_normals on the totem."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
import scores
from analytic import angle, sphere, unit
from totems import (
    CHAIN,
    DIFFUSE,
    LIGHTS,
    SAMPLES,
    TEXELS,
    VISIBILITY,
    WALK,
    by_texel,
    contents,
    edited,
    film,
    run,
    sized,
    solved,
    with_mesh,
)

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_frame, read_image, write_png
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile, read_mesh, write_ply
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.normal_maps import apply_normal_map
from meshlab_svbrdf.meshlab import pull, push

BAKE = "transfer_svbrdf_normals"


@pytest.fixture
def walk(tmp_path_factory) -> Path:
    return film(tmp_path_factory, WALK)


@pytest.fixture
def scan(walk) -> Mesh:
    return read_mesh(walk.parent / "totem.ply").mesh


@pytest.fixture
def fresh(walk, tmp_path) -> Document:
    return Document.open(walk, tmp_path)


@pytest.fixture
def texels_only(fresh) -> Document:
    run(fresh, TEXELS, **sized(WALK))
    return fresh


# Texels


def test_texels_lie_on_the_scan_where_the_charts_say(texels_only, scan, walk):
    texels = texels_only.texels()
    own = scan.vertices[scan.faces[texels.face]]
    place = np.einsum("tc,tcd->td", texels.barycentric, own)
    np.testing.assert_allclose(texels.position + texels.center, place, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(texels.normal, axis=1), 1, atol=1e-6)
    uv = np.einsum("tc,tcd->td", texels.barycentric, scan.uv[texels.face])
    size = WALK.texture
    np.testing.assert_allclose(uv[:, 0] * size - 0.5, texels.col, atol=1e-3)
    np.testing.assert_allclose((1 - uv[:, 1]) * size - 0.5, texels.row, atol=1e-3)
    mask = read_image(walk.parent / "ground_truth" / "texel_mask.png") > 127
    (inside,) = texels.to_images(np.ones(len(texels), bool), False)
    assert not (mask & ~inside).any()


def test_a_scan_without_charts_is_parametrised_and_saved_with_them(walk, scan, tmp_path):
    project = with_mesh(walk, tmp_path / "in", replace(scan, uv=None))
    document = Document.open(project, tmp_path / "out")
    said = run(document, DIFFUSE, **sized(WALK))
    assert "parametrised" in said[TEXELS].message
    texels, mesh = document.texels(), document.mesh()
    assert mesh.uv.shape == (len(mesh.faces), 3, 2)
    place = np.einsum("tc,tcd->td", texels.barycentric, mesh.vertices[mesh.faces[texels.face]])
    np.testing.assert_allclose(texels.position + texels.center, place, rtol=0, atol=1e-6)
    assert all(outcome.skipped for outcome in run(document, DIFFUSE, **sized(WALK)).values())

    document.save()
    again = Document.open(document.path)
    assert all(outcome.skipped for outcome in run(again, DIFFUSE, **sized(WALK)).values())
    np.testing.assert_allclose(again.mesh().uv, mesh.uv, atol=1e-7)
    layer = next(layer for layer in again.layers if layer.label == "totem")
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(layer.path))
    assert meshes.current_mesh().has_wedge_tex_coord()


def simplified(mesh: Mesh, faces: int) -> Mesh:
    """By MeshLab, without regard to the texture coordinates."""
    meshes = pymeshlab.MeshSet()
    identity = push(meshes, Layer("scan", content=MeshFile(mesh)))
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=faces)
    return pull(meshes, identity).mesh


def on_its_charts(document: Document, size: int) -> None:
    """Texels lie where the object's texture coordinates say."""
    texels, mesh = document.texels(), document.mesh()
    place = np.einsum("tc,tcd->td", texels.barycentric, mesh.uv[texels.face])
    np.testing.assert_allclose(place[:, 0] * size - 0.5, texels.col, atol=1e-3)


def test_charts_torn_by_simplification_are_told_and_made_anew(walk, scan, tmp_path):
    torn = simplified(scan, len(scan.faces) // 10)
    document = Document.open(with_mesh(walk, tmp_path / "in", torn), tmp_path / "out")
    first = document.apply(TEXELS, texture_size=192).message
    assert "The charts are torn" in first
    few = len(document.texels())

    # New charts take the place of the file's, in this process and for the next
    always = {"texture_size": 192, "parametrise": "always"}
    said = run(document, DIFFUSE, **{TEXELS: always})[TEXELS].message
    assert "parametrised, as asked" in said
    assert "torn" not in said
    assert len(document.texels()) > few
    uv = document.mesh().uv
    again = Document.open(document.save())
    np.testing.assert_allclose(again.mesh().uv, uv, atol=1e-7)
    np.testing.assert_allclose(again.object_layer().read().mesh.uv, uv, atol=1e-7)
    assert all(again.stale(product) == "" for product in again.results.record["products"])
    assert again.apply(TEXELS, **always).skipped

    # Charts of another size replace them
    assert not again.apply(TEXELS, texture_size=160, parametrise="always").skipped
    assert again.stale("texels") == ""
    on_its_charts(again, 160)

    # The file's own come back when asked for
    again = Document.open(again.save())
    assert run(again, DIFFUSE, **{TEXELS: {"texture_size": 192}})[TEXELS].message == first
    last = Document.open(again.save())
    assert all(last.stale(product) == "" for product in last.results.record["products"])
    for mesh in (last.mesh(), last.object_layer().read().mesh):
        np.testing.assert_array_equal(mesh.uv.astype(np.float32), torn.uv.astype(np.float32))


def test_charts_of_another_size_replace_those_of_a_scan_without(walk, scan, tmp_path):
    project = with_mesh(walk, tmp_path / "in", replace(scan, uv=None))
    document = Document.open(project, tmp_path / "out")
    run(document, DIFFUSE, **{TEXELS: {"texture_size": 192}})
    again = Document.open(document.save())
    assert "parametrised, for the mesh has no" in again.apply(TEXELS, texture_size=160).message
    assert again.stale("texels") == ""
    on_its_charts(again, 160)
    with pytest.raises(SvbrdfError, match=r"'totem' has no texture coordinates.*parametrise=auto"):
        again.apply(TEXELS, parametrise="never")


def test_charts_that_overlap_stop_the_run_unless_that_is_asked_for(walk, scan, tmp_path):
    half = len(scan.faces) // 2
    uv = scan.uv.copy()
    uv[half : 2 * half] = uv[:half]
    document = Document.open(with_mesh(walk, tmp_path / "in", replace(scan, uv=uv)), tmp_path)
    with pytest.raises(SvbrdfError, match=r"overlapping charts.*parametrise=always"):
        document.apply(TEXELS, texture_size=64)
    assert not document.has("texels")
    said = document.apply(TEXELS, texture_size=64, allow_overlap=True)
    assert "of the texels belong to several places of the surface" in said.message
    assert not ((document.texels().face >= half) & (document.texels().face < 2 * half)).any()


def test_a_point_cloud_and_charts_out_of_range_are_told(walk, scan, tmp_path):
    away = Document.open(with_mesh(walk, tmp_path / "a", replace(scan, uv=scan.uv * 0)), tmp_path)
    with pytest.raises(SvbrdfError, match="no texel lies inside a chart"):
        away.apply(TEXELS, texture_size=64)
    cloud = replace(scan, faces=scan.faces[:0], uv=None)
    with pytest.raises(DocumentError, match="no mesh layer with faces"):
        Document.open(with_mesh(walk, tmp_path / "b", cloud), tmp_path).apply(TEXELS)


# Several textures


def render_view(document: Document, walk: Path, folder: Path) -> None:
    """The held-out view is predicted: measured 31.1 dB or more, highlights too."""
    cameras = walk.parent / "ground_truth" / "views" / "project.mlp"
    document.apply("generate_svbrdf_rendering", cameras=cameras, folder=folder)
    found = scores.psnr(*(read_frame(f / "view_00.png") for f in (folder, cameras.parent)))
    assert min(found) > 30.3


@pytest.fixture
def two_textures(walk, scan, tmp_path) -> Document:
    """The lower half of the totem has the first texture, the upper half the second."""
    for name in ("low.png", "high.png"):
        write_png(tmp_path / name, np.full((8, 8, 3), 200, np.uint8))
    upper = scan.vertices[scan.faces].mean(1)[:, 1] > 0
    mesh = replace(scan, texture_index=upper.astype(np.int32))
    textures = tmp_path / "low.png", tmp_path / "high.png"
    return Document.open(with_mesh(walk, tmp_path / "in", mesh, *textures), tmp_path / "out")


def test_several_textures_give_the_same_result_in_several_images(
    two_textures, tmp_path_factory, walk, tmp_path
):
    segmentation = read_image(walk.parent / "ground_truth" / "material_id.png")
    for name in ("ids.png", "ids.1.png"):
        write_png(tmp_path / name, segmentation)
    given = sized(WALK, compute_svbrdf_materials={"image": str(tmp_path / "ids.png")})
    said = run(two_textures, **given)
    assert "in 2 images" in said[TEXELS].message
    one = Document.open(solved(tmp_path_factory, WALK))
    for name, tolerance in (("diffuse", 0.005), ("valid", 0)):
        kind = "png" if name == "valid" else "exr"
        low, high = two_textures.map(name, kind)
        assert two_textures.map_paths(name, kind)[1].name == f"{name}.1.{kind}"
        texels = two_textures.texels()
        both = by_texel(two_textures, [low, high]).astype(float)
        (single,) = one.map(name, kind)
        expected = single[texels.row, texels.col].astype(float)
        # Where two charts meet in one texel, its owner may be another face
        error = np.abs(both - expected).reshape(len(texels), -1).max(1)
        assert np.mean(error <= tolerance) > 0.97 * np.mean(np.isfinite(error))
    assert len(two_textures.map("material", "png")) == len(two_textures.map("rho_s")) == 2

    two_textures.save()
    meshes = pymeshlab.MeshSet()
    for layer in Document.open(two_textures.path).layers:
        if layer.label in ("totem", "materials", "map: rho_s"):
            meshes.load_new_mesh(str(layer.path))
            assert meshes.current_mesh().texture_number() == 2
    assert meshes.mesh_number() == 3
    render_view(two_textures, walk, tmp_path)


def test_udim_tiles_give_the_same_result_as_textures(walk, scan, tmp_path):
    upper = scan.vertices[scan.faces].mean(1)[:, 1] > 0
    scan = replace(scan, uv=np.rint(scan.uv * 2**20) / 2**20)  # exact in both tiles
    for name in ("low.png", "high.png"):
        write_png(tmp_path / name, np.full((8, 8, 3), 200, np.uint8))
    apart = replace(scan, texture_index=upper.astype(np.int32))
    tiled = replace(scan, uv=scan.uv + upper[:, None, None] * [1, 0])
    one = with_mesh(walk, tmp_path / "one", apart, tmp_path / "low.png", tmp_path / "high.png")
    other = with_mesh(walk, tmp_path / "other", tiled)
    documents = [Document.open(path, path.parent / "out") for path in (one, other)]
    small = {TEXELS: {"texture_size": 64}}
    said = [run(document, **small) for document in documents]
    assert "UDIM tiles 1001-1002" in said[1][TEXELS].message
    assert "UDIM" not in said[0][TEXELS].message
    textures, tiles = (contents(document.folder) for document in documents)
    maps = {name for name in textures if name.startswith("maps/")}
    assert len(maps) >= 16
    for name in maps:
        path = Path(name)
        stem, _, number = path.stem.partition(".")
        tile = "1002" if number == "1" else "1001"
        assert tiles[f"maps/{stem}.{tile}{path.suffix}"] == textures[name]
    for name in textures:
        if name.startswith("texels/"):
            assert tiles[name] == textures[name]

    # MeshLab shows a texture for each tile; the user's coordinates are known behind them
    documents[1].save()
    meshes = pymeshlab.MeshSet()
    saved = Document.open(documents[1].path)
    for layer in saved.layers:
        if layer.label in ("totem", "materials", "map: rho_s"):
            meshes.load_new_mesh(str(layer.path))
            mesh = meshes.current_mesh()
            assert mesh.texture_number() == 2
            assert mesh.wedge_tex_coord_matrix().max() <= 1
            assert all("1001" in name or "1002" in name for name in mesh.textures())
    assert meshes.mesh_number() == 3
    assert all(outcome.skipped for outcome in run(saved, **small).values())


def test_an_obj_with_an_image_for_each_tile_is_udim(walk, scan, tmp_path):
    uv = scan.uv + (scan.vertices[scan.faces].mean(1)[:, 1] > 0)[:, None, None] * [0, 1]
    lines = ["mtllib totem.mtl", "usemtl all", *(f"v {x} {y} {z}" for x, y, z in scan.vertices)]
    lines += [f"vt {u} {v}" for u, v in uv.reshape(-1, 2)]
    corners = enumerate((scan.faces + 1).tolist())
    lines += ["f " + " ".join(f"{v}/{3 * f + k + 1}" for k, v in enumerate(c)) for f, c in corners]
    (tmp_path / "totem.obj").write_text("\n".join(lines))
    (tmp_path / "totem.mtl").write_text("newmtl all\nmap_Kd paint.<UDIM>.png\n")
    (tmp_path / "in").mkdir()
    path = edited(
        walk, tmp_path / "in", lambda project: project.set_mesh("totem", tmp_path / "totem.obj")
    )
    document = Document.open(path, tmp_path / "out")
    for name in ("n.1001.png", "n.1011.png"):
        write_png(tmp_path / name, np.full((8, 8, 3), (128, 128, 255), np.uint8))
    given = {"texture_size": 64, "normal_map": str(tmp_path / "n.1001.png")}
    said = run(document, TEXELS, **{TEXELS: given})[TEXELS].message
    assert "in 2 images" in said
    assert "UDIM tiles 1001, 1011" in said
    assert document.tiles() == [1001, 1011]
    write_png(tmp_path / "n.1011.png", np.full((8, 8, 3), (128, 120, 255), np.uint8))
    assert not document.apply(TEXELS, **given).skipped
    (tmp_path / "n.1011.png").unlink()
    with pytest.raises(DocumentError, match=r"n\.1011\.png"):
        document.apply(TEXELS, **given)


def test_a_second_textures_missing_image_is_named(two_textures, tmp_path, walk):
    write_png(tmp_path / "n.png", np.full((8, 8, 3), (128, 128, 255), np.uint8))
    with pytest.raises(DocumentError, match=r"n\.1\.png"):
        two_textures.apply(TEXELS, texture_size=64, normal_map=tmp_path / "n.png")


# Normals


def test_a_normal_map_gives_the_texels_their_normals(fresh, texels_only, tmp_path):
    plain = texels_only.texels()
    shade = np.array([0.3, -0.2, 1]) / np.linalg.norm([0.3, -0.2, 1])
    for space, vector in (("tangent", np.array([0, 0, 1.0])), ("object", shade)):
        write_png(tmp_path / f"{space}.png",
                  np.full((16, 16, 3), np.rint((vector + 1) / 2 * 65535), np.uint16))  # fmt: skip
        said = fresh.apply(
            TEXELS, texture_size=WALK.texture, normal_map=tmp_path / f"{space}.png",
            normal_space=space,
        )  # fmt: skip
        assert f"normals of {space}.png" in said.message
        expected = (
            plain.normal if space == "tangent" else np.broadcast_to(shade, plain.normal.shape)
        )
        assert angle(unit(fresh.texels().normal), unit(expected)).max() < 0.01
        assert fresh.array("texels_detail").all()


def test_an_object_space_map_turns_with_its_layer(fresh, tmp_path):
    write_png(tmp_path / "up.png", np.full((8, 8, 3), [128, 255, 128], np.uint8))
    fresh.object_layer().matrix[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    fresh.apply(TEXELS, texture_size=48, normal_map=tmp_path / "up.png", normal_space="object")
    assert angle(unit(fresh.texels().normal), np.array([-1.0, 0, 0])).max() < 0.5


def test_bad_normal_maps_are_named(fresh, tmp_path):
    with pytest.raises(DocumentError, match=r"nothing\.png"):
        fresh.apply(TEXELS, normal_map=tmp_path / "nothing.png")
    write_png(tmp_path / "alpha.png", np.zeros((8, 8, 4), np.uint8))
    with pytest.raises(SvbrdfError, match="without alpha"):
        fresh.apply(TEXELS, normal_map=tmp_path / "alpha.png")


@pytest.fixture
def with_detail(walk, scan, tmp_path):
    """The totem with wrong normals; and a layer with the right ones, all of it above `cut`."""

    def make(cut: float, offset: float = 0.0) -> Document:
        kept = scan.vertices[scan.faces][..., 1].min(1) > cut
        moved = scan.vertices + np.array([offset, 0, 0])
        detail = replace(scan, vertices=moved, faces=scan.faces[kept], uv=None)
        write_ply(tmp_path / "detail.ply", detail, dtype=np.float64)
        wrong = replace(scan, normals=unit(scan.normals + np.array([0.2, 0, 0.1])))
        project = edited(
            with_mesh(walk, tmp_path / "in", wrong),
            tmp_path / "in",
            lambda project: project.add_mesh("scan", tmp_path / "detail.ply"),
        )
        document = Document.open(project, tmp_path / "out")
        document.set(object="totem")
        run(document, TEXELS, **sized(WALK))
        return document

    return make


def test_baked_normals_are_the_detailed_layers_and_misses_are_marked(with_detail, scan):
    document = with_detail(cut=0.0)
    own = document.texels()
    said = document.apply(BAKE, source="scan", max_distance="0.1%")
    baked = document.attribute("baked") > 0
    height = own.position[:, 1] + own.center[1]
    assert baked[height > 0.08].all()
    assert not baked[height < -0.01].any()
    assert said.message.startswith(f"{100 * baked.mean():.1f} % of the texels")
    texels = document.texels()
    np.testing.assert_allclose(texels.normal[~baked], own.normal[~baked], rtol=0, atol=2e-7)
    corners = scan.vertex_normals()[scan.faces[own.face]]
    true = unit(np.einsum("tc,tcd->td", own.barycentric, corners))
    assert np.quantile(angle(unit(texels.normal), true)[baked], 0.99) < 0.05

    # The map in tangent space says the same, within 8 bits
    read, valid = apply_normal_map(own, document.mesh(), document.map("normal", "png"))
    assert angle(unit(read), unit(texels.normal))[valid].max() < 0.7

    assert "map: normal" in document.results.record["products"]["texels"]["layers"]

    # A second run keeps them; texels made anew have their own normals again
    assert run(document, TEXELS, **sized(WALK))[TEXELS].skipped
    document.apply(TEXELS, force=True, texture_size=WALK.texture)
    np.testing.assert_array_equal(document.texels().normal, own.normal)
    assert not document.has_array("texels_detail")


def test_later_stages_and_renderings_see_baked_normals(
    with_detail, walk, tmp_path_factory, tmp_path
):
    document = with_detail(cut=-9.0)
    run(document, SAMPLES, **sized(WALK))
    document.apply(BAKE, source="scan")
    assert document.stale("samples") == "texels"
    assert not any(document.apply(name).skipped for name in CHAIN[1:])
    one = Document.open(solved(tmp_path_factory, WALK))
    found = [[light["direction"] for light in d.json("lights")["lights"]] for d in (document, one)]
    assert angle(*np.array(found)).max() < 0.25  # measured .15
    render_view(document, walk, tmp_path)


def test_a_changed_source_makes_what_follows_stale(with_detail):
    document = with_detail(cut=-9.0)
    document.apply(BAKE, source="scan")
    later = (VISIBILITY, SAMPLES)
    for name in later:
        document.apply(name)
    document = Document.open(document.save())
    assert document.stale("samples") == ""
    layer = next(layer for layer in document.layers if layer.label == "scan")
    mesh = layer.read().mesh
    layer.content = replace(layer.content, mesh=replace(mesh, vertices=mesh.vertices * 1.001))
    assert document.stale("samples") == "layer scan"
    with pytest.raises(SvbrdfError, match=f"but the layer scan changed since: run {TEXELS}"):
        document.apply(BAKE, source="scan")
    run(document, TEXELS, **sized(WALK))
    document.apply(BAKE, source="scan")
    assert document.stale("texels") == ""
    assert not any(document.apply(name).skipped for name in later)

    # Where the detailed layer goes away, as MeshLab's saving drops hidden ones, results stay
    document.layers.remove(layer)
    assert document.stale("samples") == ""


def test_a_wrong_or_distant_source_is_told(with_detail):
    document = with_detail(cut=0.0, offset=5.0)
    for source in ("scam", "", "totem"):
        with pytest.raises(SvbrdfError, match=r"label of another mesh layer .there are: 'scan'"):
            document.apply(BAKE, source=source)
    with pytest.raises(SvbrdfError, match=r"'scan' is nowhere within .* are aligned"):
        document.apply(BAKE, source="scan")
    assert not document.map_paths("normal", "png")


# Visibility


def test_visibility_holds_36_coefficients_of_every_vertex(texels_only, scan):
    said = texels_only.apply(VISIBILITY, directions=128)
    coefficients = texels_only.array("visibility")
    assert coefficients.shape == (len(scan.vertices), 36)
    openness = coefficients[:, 0] * np.sqrt(4 * np.pi) / (2 * np.pi)
    assert -0.05 < openness.min() < 0.6 < openness.max() < 1.05
    assert "of the rays are blocked" in said.message
    texels_only.apply(VISIBILITY, directions=128, bands=2)
    few = texels_only.array("visibility")
    np.testing.assert_allclose(few[:, :4], coefficients[:, :4], atol=1e-6)
    assert not few[:, 4:].any()
    assert "as asked" in texels_only.apply(VISIBILITY, mode="never").message
    assert texels_only.array("visibility").shape == (0, 36)


def test_a_convex_object_needs_no_visibility(walk, tmp_path):
    ball = Document.open(with_mesh(walk, tmp_path / "in", sphere(12)), tmp_path)
    ball.apply(TEXELS, texture_size=32)
    assert ball.apply(VISIBILITY).message.startswith("skipped: only 0.")
    assert len(ball.array("visibility")) == 0
    assert not ball.apply(VISIBILITY, mode="always").message.startswith("skipped")


# Where the object lies, and through which lens


@pytest.mark.parametrize("by_matrix", [True, False])
def test_map_coordinates_change_nothing(walk, scan, tmp_path, tmp_path_factory, by_matrix):
    """A scan 25 times as large at 1e6 m: D within 1e-3 of 100, lights within 1e-4°."""
    scale, offset = 25.0, np.array([1e6, 4e5, 300.0])
    world = np.eye(4)
    world[:3, :3] *= scale
    world[:3, 3] = offset

    def move(project):
        for raster in project.rasters:
            camera = raster.camera
            raster.camera = replace(camera, t=scale * camera.t - camera.R @ offset)
        if by_matrix:
            project.meshes[0].matrix = world

    folder = tmp_path / "moved"
    source = walk if by_matrix else with_mesh(walk, tmp_path / "in", scan.transformed(world))
    moved = Document.open(edited(source, folder, move), tmp_path)
    run(moved, LIGHTS, **sized(WALK))
    one = Document.open(solved(tmp_path_factory, WALK))
    assert np.mean(moved.attribute("samples") == one.attribute("samples")) > 0.99
    error = np.abs(moved.attribute("diffuse") - one.attribute("diffuse")).max(1)
    same = error[np.isfinite(error)] < 1e-3
    assert same.mean() > 0.998  # one texel in a thousand gains or loses a sample
    found, expected = (
        np.array([light["direction"] for light in d.json("lights_found")["lights"]])
        for d in (moved, one)
    )
    assert angle(found, expected).max() < 1e-4  # measured 4e-6


def test_a_principal_point_off_the_middle_and_pixels_that_are_not_square(
    tmp_path_factory, tmp_path
):
    options = replace(WALK, principal=(9.0, -6.0), aspect=1.15, views=0)
    project = film(tmp_path_factory, options)
    document = Document.open(project, tmp_path)
    run(document, **sized(options))
    truth = project.parent / "ground_truth"
    error, lights = scores.diffuse(document, truth), scores.lights(document, truth)
    assert error.mean() < 1.0  # measured .88
    assert (lights.missed, lights.false) == (0, 0)
    assert lights.angle < 0.25  # measured .17
