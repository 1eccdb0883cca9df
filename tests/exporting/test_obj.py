"""OBJ: read again it is the mesh; MTL: what its words say."""

import numpy as np

from meshlab_svbrdf.document.images import write_png
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.exporting.obj import ObjMaterial, mtl_text, obj_text
from meshlab_svbrdf.geometry.mesh import Mesh


def written(folder, mesh, *materials):
    names = [m.name for m in materials]
    (folder / "stone.obj").write_text(obj_text(mesh, names, "bare", "stone.mtl", "nobody"))
    bare = ObjMaterial("bare", {}, 0.0, 1.0, 0.2)
    (folder / "stone.mtl").write_text(mtl_text([*materials, bare], "nobody"))
    return read_mesh(folder / "stone.obj")


def test_read_again_it_is_the_mesh(stone, tmp_path):
    mesh = Mesh(stone.vertices / 3 + 1e6, stone.faces, uv=stone.uv,
                texture_index=np.array([1, 0, 1, -1], np.int32))  # fmt: skip
    found = written(
        tmp_path, mesh, ObjMaterial("a", {"map_Kd": "a.png"}), ObjMaterial("b", {"map_Kd": "b.png"})
    )
    order = [1, 0, 2, 3]  # by texture
    np.testing.assert_allclose(found.mesh.vertices, mesh.vertices, rtol=1e-11)
    np.testing.assert_array_equal(found.mesh.faces, mesh.faces[order])
    np.testing.assert_allclose(found.mesh.uv, mesh.uv[order], atol=1e-7)
    np.testing.assert_array_equal(found.mesh.texture_index, mesh.texture_index[order])
    np.testing.assert_allclose(found.mesh.normals, mesh.vertex_normals(), atol=1e-6)
    assert [path.name for path in found.textures] == ["a.png", "b.png"]


def test_the_library_says_what_the_maps_are_times(stone, tmp_path):
    write_png(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8))
    maps = {"map_Kd": "a.png", "map_Ks": "ks.png", "map_Ns": "ns.png", "map_Pr": "r.png"}
    text = mtl_text([ObjMaterial("a", maps, 1.5, 344.0)], "nobody")
    lines = text.splitlines()
    for line in ("Ks 1.5 1.5 1.5", "Ns 344", "Kd 1 1 1", "illum 2", "Pm 0", "map_Ns ns.png"):
        assert line in lines
    written(tmp_path, stone, ObjMaterial("a", maps))
