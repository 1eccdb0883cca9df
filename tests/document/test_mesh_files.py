"""Mesh files: what is written comes back, plyfile and MeshLab read the same, damage is named."""

import os
from pathlib import Path

import cv2
import numpy as np
import plyfile
import pymeshlab
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meshlab_svbrdf.document.mesh_file import fan
from meshlab_svbrdf.document.mesh_files import MeshFile, read_mesh, write_ply
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.mesh import Mesh


def some_mesh(seed: int = 0, vertices: int = 12, faces: int = 20) -> Mesh:
    rng = np.random.default_rng(seed)
    single = np.float32
    normals = rng.normal(size=(vertices, 3)).astype(single).astype(float)
    corners = np.array([rng.choice(vertices, 3, replace=False) for _ in range(faces)])
    return Mesh(
        vertices=rng.normal(size=(vertices, 3)).astype(single).astype(float),
        faces=corners.astype(np.int32).reshape(-1, 3),
        normals=normals,
        uv=rng.random((faces, 3, 2)).astype(single).astype(float),
    )


def polygons(counts: list[int], seed: int = 0) -> tuple[np.ndarray, list[np.ndarray], list]:
    """Vertices, polygons of the given corners, and their wedge coordinates (0 corners: none)."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(9, 3)).astype(np.float32)
    corners = [rng.permutation(9)[:n].astype(np.int32) for n in counts]
    return vertices, corners, [rng.random(2 * n).astype(np.float32) for n in counts]


def write_with_plyfile(path, counts, *, text=False, order="<", wedge=True, **names) -> tuple:
    vertices, corners, uv = polygons(counts)
    vertex = np.array([tuple(v) for v in vertices], [(n, names.get("real", "f4")) for n in "xyz"])
    fields = [(names.get("corners", "vertex_indices"), "O")] + [("texcoord", "O")] * wedge
    face = np.empty(len(counts), fields)
    face[fields[0][0]] = corners
    if wedge:
        face["texcoord"] = uv
    elements = [
        plyfile.PlyElement.describe(vertex, "vertex"),
        plyfile.PlyElement.describe(
            face, "face", len_types={}, val_types={fields[0][0]: "i4", "texcoord": "f4"}
        ),
    ]
    plyfile.PlyData(elements, text=text, byte_order=order).write(str(path))
    return vertices, corners, uv


def expected_fan(corners: list, uv: list) -> tuple[np.ndarray, np.ndarray]:
    faces, wedges = [], []
    for c, w in zip(corners, uv, strict=True):
        for i in range(1, len(c) - 1):
            faces.append(c[[0, i, i + 1]])
            wedges.append(w.reshape(-1, 2)[[0, i, i + 1]])
    return np.array(faces), np.array(wedges)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_what_is_written_comes_back(tmp_path, dtype):
    rng = np.random.default_rng(1)
    mesh = some_mesh()
    index = np.arange(20, dtype=np.int32) % 2
    mesh = Mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.uv, index)
    color = rng.integers(0, 256, (12, 4), np.uint8)
    attributes = {"svbrdf_threshold": rng.random(12), "svbrdf_nan": np.full(12, np.nan)}
    textures = [tmp_path / "maps/a.png", tmp_path / "maps/b.png"]
    (tmp_path / "layers").mkdir()
    path = tmp_path / "layers/a.ply"
    write_ply(
        path,
        mesh,
        textures=textures,
        color=color,
        quality=rng.random(12),
        vertex_attributes=attributes,
        dtype=dtype,
    )
    back = read_mesh(path)
    for name in ("vertices", "faces", "normals", "uv", "texture_index"):
        np.testing.assert_array_equal(getattr(back.mesh, name), getattr(mesh, name))
    assert back.textures == tuple(textures)
    assert back.mesh.faces.dtype == np.int32
    np.testing.assert_array_equal(back.vertex_color, color)
    assert back.quality is not None
    assert back.quality.dtype == dtype
    for name, values in attributes.items():
        np.testing.assert_array_equal(back.vertex_attributes[name], values.astype(dtype))
    assert set(back.vertex_attributes) == set(attributes)
    assert b"TextureFile ../maps/a.png\n" in path.read_bytes()


@settings(deadline=None)
@given(seed=st.integers(0, 1000), vertices=st.integers(3, 40), faces=st.integers(0, 60))
def test_any_mesh_comes_back_and_plyfile_agrees(tmp_path_factory, seed, vertices, faces):
    mesh = some_mesh(seed, vertices, faces)
    path = tmp_path_factory.getbasetemp() / "any.ply"
    write_ply(path, mesh, quality=np.arange(vertices))
    back = read_mesh(path).mesh
    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    if faces:
        np.testing.assert_array_equal(back.uv, mesh.uv)
    ply = plyfile.PlyData.read(str(path))
    np.testing.assert_array_equal(ply["vertex"]["quality"], np.arange(vertices))
    assert [row.tolist() for row in ply["face"]["vertex_indices"]] == mesh.faces.tolist()


def test_points_far_from_the_origin_keep_their_distances(tmp_path):
    points = np.random.default_rng(0).random((50, 3)) + 1e6
    write_ply(tmp_path / "far.ply", points)
    np.testing.assert_array_equal(read_mesh(tmp_path / "far.ply").mesh.vertices, points)
    write_ply(tmp_path / "near.ply", points - 1e6)
    assert b"property float x" in (tmp_path / "near.ply").read_bytes()


@pytest.mark.parametrize("counts", [[3, 3, 3, 3], [4, 4], [3, 5, 4, 3], [6]])
@pytest.mark.parametrize(("text", "order"), [(True, "="), (False, "<"), (False, ">")])
@pytest.mark.parametrize("corners_name", ["vertex_indices", "vertex_index"])
def test_every_encoding_of_polygons_reads_alike(tmp_path, counts, text, order, corners_name):
    path = tmp_path / "a.ply"
    vertices, corners, uv = write_with_plyfile(
        path, counts, text=text, order=order, corners=corners_name
    )
    faces, wedges = expected_fan(corners, uv)
    mesh = read_mesh(path).mesh
    np.testing.assert_allclose(mesh.vertices, vertices, rtol=1e-7 if text else 0)
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_allclose(mesh.uv, wedges, rtol=1e-7 if text else 0)


def ascii_ply(path: Path, vertex: str, face: str, rows: str, *, v=3, f=1, comment="") -> Path:
    header = f"ply\nformat ascii 1.0\n{comment}element vertex {v}\n{vertex}element face {f}\n{face}"
    path.write_text(f"{header}end_header\n{rows}", encoding="utf-8")
    return path


XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"


@pytest.mark.parametrize("pair", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_coordinates_per_vertex_become_wedges(tmp_path, pair):
    vertex = XYZ + "".join(f"property float {name}\n" for name in pair) + "property float w2\n"
    rows = "0 0 0 .25 .5 7\n1 0 0 1 0 8\n0 1 0 0 1 9\n3 2 0 1\n"
    file = read_mesh(ascii_ply(tmp_path / "a.ply", vertex, LIST, rows))
    np.testing.assert_array_equal(file.mesh.uv, [[[0, 1], [0.25, 0.5], [1, 0]]])
    assert list(file.vertex_attributes) == ["w2"]


def test_point_attributes_and_colours_of_lists_and_text(tmp_path):
    vertex = (
        XYZ
        + "property list uchar double svbrdf_p\n"
        + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    )
    rows = "0 0 0 2 5 6 1 2 3\n1 0 0 2 7 8 4 5 6\n0 1 0 2 9 10 7 8 255\n3 0 1 2\n"
    file = read_mesh(ascii_ply(tmp_path / "a.ply", vertex, LIST, rows))
    np.testing.assert_array_equal(file.vertex_attributes["svbrdf_p"], [[5, 6], [7, 8], [9, 10]])
    assert file.vertex_color is not None
    np.testing.assert_array_equal(file.vertex_color[2], [7, 8, 255, 255])
    assert file.vertex_color.dtype == np.uint8


def test_faces_without_coordinates_have_no_texture(tmp_path):
    face = LIST + "property list uchar float texcoord\n"
    rows = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n3 2 1 0 0\n"
    path = ascii_ply(
        tmp_path / "a.ply", XYZ, face, rows, f=2, comment="comment TextureFile ä.png\n"
    )
    file = read_mesh(path)
    assert file.textures == (tmp_path / "ä.png",)
    assert file.mesh.texture_index is not None
    assert file.mesh.texture_index.tolist() == [0, -1]
    assert file.mesh.uv is not None
    assert not file.mesh.uv[1].any()
    write_ply(tmp_path / "b.ply", file.mesh)
    back = read_mesh(tmp_path / "b.ply").mesh
    np.testing.assert_array_equal(back.texture_index, file.mesh.texture_index)


@settings(deadline=None)
@given(st.lists(st.integers(3, 9), max_size=20))
def test_fans_cover_each_polygon_with_its_corners(counts):
    polygon, corner = fan(np.array(counts, np.int64), Path("p"))
    assert len(polygon) == sum(n - 2 for n in counts)
    starts = np.cumsum([0, *counts])
    for i, n in enumerate(counts):
        own = corner[polygon == i] - starts[i]
        assert own.tolist() == [[0, k, k + 1] for k in range(1, n - 1)]


def test_meshlab_reads_what_we_write(tmp_path):
    (tmp_path / "layers").mkdir()
    (tmp_path / "maps").mkdir()
    for name, value in (("a", 50), ("b", 90)):
        cv2.imwrite(str(tmp_path / f"maps/{name}.png"), np.full((4, 4, 3), value, np.uint8))
    mesh = some_mesh()
    index = (np.arange(20) >= 10).astype(np.int32)
    mesh = Mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.uv, index)
    quality = np.linspace(0, 1, 12)
    path = tmp_path / "layers/a.ply"
    write_ply(
        path,
        mesh,
        textures=[tmp_path / "maps/a.png", tmp_path / "maps/b.png"],
        color=np.full((12, 3), 7, np.uint8),
        quality=quality,
        vertex_attributes={"svbrdf_rho_s": quality},
    )
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    theirs = meshes.current_mesh()
    np.testing.assert_array_equal(theirs.vertex_matrix(), mesh.vertices)
    np.testing.assert_array_equal(theirs.face_matrix(), mesh.faces)
    np.testing.assert_allclose(theirs.vertex_normal_matrix(), mesh.normals, atol=1e-6)
    np.testing.assert_array_equal(theirs.wedge_tex_coord_matrix(), mesh.uv.reshape(-1, 2))
    np.testing.assert_allclose(theirs.vertex_scalar_array(), quality, atol=1e-7)
    assert {name: image.width() for name, image in theirs.textures().items()} == {
        "../maps/a.png": 4,
        "../maps/b.png": 4,
    }

    # And we read what MeshLab makes of it, as PLY (binary and text) and as OBJ
    for name, options in (
        ("b.ply", {"save_vertex_normal": True}),
        ("t.ply", {"save_vertex_normal": True, "binary": False}),
        ("b.obj", {"save_vertex_color": True}),
    ):
        meshes.save_current_mesh(str(tmp_path / "layers" / name), save_textures=False, **options)
        back = read_mesh(tmp_path / "layers" / name)
        np.testing.assert_allclose(back.mesh.vertices, mesh.vertices, atol=2e-6)
        np.testing.assert_array_equal(back.mesh.faces, mesh.faces)
        np.testing.assert_allclose(back.mesh.uv, mesh.uv, atol=2e-6)
        np.testing.assert_array_equal(back.mesh.texture_index, index)
        assert back.textures == (tmp_path / "maps/a.png", tmp_path / "maps/b.png")
        assert back.vertex_color is not None
        assert back.vertex_color[0].tolist() == [7, 7, 7, 255]


OBJ = """# comment
mtllib a.mtl
o thing
v 0 0 0
v 1 0 0 # corner
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
vn 1 0 0
g front
usemtl red
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl blue
f -4/-4 -3/-3 -2/-2
usemtl bare
f 1//2 3//2 \\
 4//2
v 5 5 5
f -1 1 2
"""
MTL = """newmtl red
Kd 1 0 0
map_Kd -s 1 1 1 -clamp on red image.png
newmtl blue
map_Kd textures\\blue.png
newmtl bare
Kd 1 1 1
"""


def test_obj_with_polygons_materials_and_indices_of_every_form(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(MTL)
    file = read_mesh(tmp_path / "a.obj")
    assert file.textures == (tmp_path / "red image.png", tmp_path / "textures/blue.png")
    mesh = file.mesh
    expected = [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [4, 0, 1]]
    np.testing.assert_array_equal(mesh.faces, expected)
    np.testing.assert_array_equal(mesh.texture_index, [0, 0, 1, -1, -1])
    assert mesh.uv is not None
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_array_equal(mesh.uv[:3], square[[[0, 1, 2], [0, 2, 3], [0, 1, 2]]])
    assert not mesh.uv[3:].any()
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals[1], [0, 0, 1])
    np.testing.assert_allclose(mesh.normals[0], np.sqrt([0.5, 0, 0.5]))
    assert not mesh.normals[4].any()


def test_obj_of_bare_geometry(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0 1 0 .5\nv 1 0 0 0 0 0\nv 0 1 0 1 1 1\nf 1 2 3\n")
    file = read_mesh(tmp_path / "a.obj")
    assert (file.mesh.uv, file.mesh.normals, file.mesh.texture_index) == (None, None, None)
    assert file.vertex_color is not None
    np.testing.assert_array_equal(file.vertex_color[0], [255, 0, 128, 255])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("v 1 1 0\n", "v 1 1\n", "numbers in each v line"),
        ("v 1 1 0\n", "v 1 1 x\n", "cannot be read"),
        ("v 1 1 0\n", "v 1 nan 0\n", "vertex 2 is .*finite"),
        ("f -1 1 2", "f -6 1 2", "vertex index is -6"),
        ("f -1 1 2", "f 6 1 2", "vertex index is 6, but only 1 to 5"),
        ("f -1 1 2", "f 0 1 2", "vertex index is 0"),
        ("f -1 1 2", "f 1 2", "2 corners"),
        ("f -1 1 2", "f 1/1/1/1 1 2", "corner is not"),
        ("f -1 1 2", "f 1/9 1/1 2/1", "texture coordinate index is 9"),
        ("mtllib a.mtl", "mtllib b.mtl", "material library"),
        ("mtllib a.mtl", "mtllib a\0.mtl", "material library"),
        ("mtllib a.mtl", f"mtllib {'a' * 5000}.mtl", "material library"),
    ],
)
def test_bad_obj_files_say_what_is_wrong(tmp_path, old, new, says):
    assert old in OBJ
    (tmp_path / "a.obj").write_text(OBJ.replace(old, new))
    (tmp_path / "a.mtl").write_text(MTL)
    with pytest.raises(DocumentError, match=says) as caught:
        read_mesh(tmp_path / "a.obj")
    assert "a.obj" in str(caught.value)


@pytest.mark.parametrize("bytes_kept", [2, 40, 0.5, 0.9, -1])
@pytest.mark.parametrize("counts", [[3] * 8, [3, 4, 5, 3]])
def test_a_ply_that_is_cut_off_is_refused(tmp_path, bytes_kept, counts):
    for text in (True, False):
        write_with_plyfile(tmp_path / "a.ply", counts, text=text)
        data = (tmp_path / "a.ply").read_bytes().rstrip(b"\n" if text else b"")
        keep = int(bytes_kept * len(data)) if isinstance(bytes_kept, float) else bytes_kept
        if text and keep == -1:
            keep = data.rindex(b" ")  # half a number is a number
        (tmp_path / "a.ply").write_bytes(data[:keep])
        with pytest.raises(DocumentError, match=r"a\.ply"):
            read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("vertex", "face", "rows", "says"),
    [
        (XYZ, LIST, "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", "vertex 1 is .*finite"),
        (XYZ, LIST, "0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n", "vertex 1 is .*finite"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "face 0 is .*below 3"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "face 0 is .*below 3"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "vertex_indices holds 1.5"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 nan\n", "vertex_indices holds nan"),
        (
            XYZ + "property uchar red\nproperty uchar green\nproperty uchar blue\n",
            LIST,
            "0 0 0 1 2 3\n1 0 0 256 0 0\n0 1 0 0 0 0\n3 0 1 2\n",
            "colour holds 256",
        ),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "2 corners"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", "-3 items"),
        (XYZ, LIST, "0 0 0\n1 0 0\n0 1 zero\n3 0 1 2\n", "numbers cannot be read"),
        (XYZ, "property int other\n", "0 0 0\n1 0 0\n0 1 0\n3\n", "no vertex_indices"),
        (XYZ, "property int vertex_indices\n", "0 0 0\n1 0 0\n0 1 0\n3\n", "not lists"),
        (XYZ.replace("z", "q"), LIST, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "no vertices with x, y, z"),
        (XYZ.replace("float x", "quad x"), LIST, "0 0 0\n", "malformed PLY header"),
        (
            XYZ,
            LIST + "property list uchar float texcoord\n",
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 4 0 0 1 1\n",
            "3 corners and 4 texture coordinates",
        ),
        (
            XYZ,
            LIST + "property list uchar float texcoord\n",
            "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 1 nan 0\n",
            "texture coordinates of face 0",
        ),
    ],
)
def test_bad_ply_files_say_what_is_wrong(tmp_path, vertex, face, rows, says):
    path = ascii_ply(tmp_path / "a.ply", vertex, face, rows)
    with pytest.raises(DocumentError, match=says) as caught:
        read_mesh(path)
    assert "a.ply" in str(caught.value)


@settings(deadline=None, max_examples=300)
@example(kind="binary", at=243, damage=b"\x7f")  # a signalling NaN
@given(
    kind=st.sampled_from(["binary", "mixed", "text", "obj"]),
    at=st.integers(0, 10**6),
    damage=st.binary(min_size=1, max_size=8),
)
def test_damage_is_either_harmless_or_a_document_error(tmp_path_factory, kind, at, damage):
    folder = tmp_path_factory.getbasetemp()
    path = folder / f"damaged.{'obj' if kind == 'obj' else 'ply'}"
    if kind == "obj":
        path.write_text(OBJ.replace("mtllib a.mtl\n", ""))
    else:
        write_with_plyfile(path, [3, 4, 3] if kind == "mixed" else [3] * 3, text=kind == "text")
    data = bytearray(path.read_bytes())
    at %= len(data)
    data[at : at + len(damage)] = damage
    path.write_bytes(data)
    try:
        mesh = read_mesh(path).mesh
    except DocumentError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.faces) == 0 or 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.stl").write_text("solid")
    (tmp_path / "a.ply").write_text("no mesh")
    for name, says in (("b.ply", "not exist"), ("a.stl", "PLY or OBJ"), ("a.ply", "not a PLY")):
        with pytest.raises(DocumentError, match=says):
            read_mesh(tmp_path / name)
    write_ply(tmp_path / "empty.ply", np.zeros((1, 3)))
    data = (tmp_path / "empty.ply").read_bytes().replace(b"element vertex 1", b"element vertex 0")
    (tmp_path / "empty.ply").write_bytes(data)
    with pytest.raises(DocumentError, match="no vertices"):
        read_mesh(tmp_path / "empty.ply")


def test_what_would_not_come_back_is_not_written(tmp_path):
    mesh = some_mesh()
    bad = mesh.vertices.copy()
    bad[3, 1] = np.nan
    for kwargs, error, says in (
        ({"mesh": Mesh(bad, mesh.faces)}, DocumentError, "vertex 3"),
        ({"mesh": Mesh(mesh.vertices, mesh.faces + 9)}, DocumentError, "below 12"),
        ({"mesh": mesh, "textures": [tmp_path / "a b.png"]}, DocumentError, "space"),
        ({"mesh": mesh, "quality": np.zeros(3)}, ValueError, "quality: expected shape"),
        ({"mesh": mesh, "quality": np.full(12, 1e300)}, ValueError, "quality: values exceed"),
        ({"mesh": mesh, "color": np.zeros((12, 3))}, ValueError, "uint8"),
        ({"mesh": mesh, "vertex_attributes": {"x": np.zeros(12)}}, ValueError, "cannot name"),
        ({"mesh": mesh, "vertex_attributes": {"a b": np.zeros(12)}}, ValueError, "cannot name"),
    ):
        with pytest.raises(error, match=says):
            write_ply(tmp_path / "a.ply", **kwargs)
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("scene", ["bust_floods", "goldcape"])
def test_the_scenes_meshes_agree_with_plyfile_and_meshlab(scene, tmp_path):
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of scenes")
    path = Path(scenes) / scene / "mesh.ply"
    file: MeshFile = read_mesh(path)
    known = {"face": {"vertex_indices": 3, "texcoord": 6}}
    ply = plyfile.PlyData.read(str(path), known_list_len=known)
    for i, name in enumerate("xyz"):
        np.testing.assert_array_equal(file.mesh.vertices[:, i], ply["vertex"][name])
    np.testing.assert_array_equal(file.mesh.faces, ply["face"]["vertex_indices"])
    assert file.mesh.uv is not None
    np.testing.assert_array_equal(file.mesh.uv.reshape(-1, 6), ply["face"]["texcoord"])
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    np.testing.assert_array_equal(meshes.current_mesh().vertex_matrix(), file.mesh.vertices)
    write_ply(tmp_path / "a.ply", file.mesh, textures=file.textures, dtype=np.float64)
    back = read_mesh(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.mesh.vertices, file.mesh.vertices)
    np.testing.assert_array_equal(back.mesh.uv, file.mesh.uv)
    assert back.textures == file.textures


def test_an_objs_texture_coordinates_may_leave_out_v(tmp_path):
    path = tmp_path / "strip.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0\nvt 0.25\nvt 1\nf 1/1 2/2 3/3\n")
    np.testing.assert_array_equal(read_mesh(path).mesh.uv, [[[0, 0], [0.25, 0], [1, 0]]])
