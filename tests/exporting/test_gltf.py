"""glTF: the accessors hold the mesh, the lamps stand where they do, files are well formed."""

import json
import struct

import numpy as np
import pytest
from analytic import angle, unit
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.exporting.corners import joined_vertices, textured_faces
from meshlab_svbrdf.exporting.gltf import Builder, Image, Material, glb_of, text_of, turn_to
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.mikktspace import corner_tangents
from meshlab_svbrdf.rendering.environment_lights import Illumination

TYPES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def parts(glb: bytes) -> tuple[dict, bytes]:
    """A GLB's two chunks."""
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb))
    size, kind = struct.unpack_from("<I4s", glb, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    told = json.loads(glb[20 : 20 + size])
    rest, kind = struct.unpack_from("<I4s", glb, 20 + size)
    assert kind == b"BIN\0"
    data = glb[28 + size :]
    assert len(data) == rest == told["buffers"][0]["byteLength"]
    return told, data


def values(told: dict, data: bytes, index: int) -> np.ndarray:
    """An accessor's content."""
    accessor = told["accessors"][index]
    view = told["bufferViews"][accessor["bufferView"]]
    kind = np.float32 if accessor["componentType"] == 5126 else np.uint32
    width = TYPES[accessor["type"]]
    found = np.frombuffer(data, kind, accessor["count"] * width, view["byteOffset"])
    return found.reshape(-1, width)


@pytest.fixture
def mesh(stone) -> Mesh:
    return Mesh(stone.vertices + 1e6, stone.faces, uv=stone.uv)


def built(mesh, light=None, embed=True, **material) -> tuple[dict, bytes]:
    builder = Builder("stone", embed)
    tangents = corner_tangents(mesh)
    vertices = joined_vertices(mesh, np.arange(len(mesh.faces)), tangents)
    index = builder.material(Material("stone", **material), True)
    builder.object([builder.primitive(vertices, index)], mesh.center)
    if light is not None:
        builder.lamps(light, mesh.center, mesh.radius)
    return builder.finish("nobody", {})


def test_accessors_hold_the_mesh(mesh):
    told, data = parts(glb_of(*built(mesh)))
    primitive = told["meshes"][0]["primitives"][0]
    get = lambda name: values(told, data, primitive["attributes"][name])  # noqa: E731
    faces = values(told, data, primitive["indices"]).reshape(-1, 3)
    place = get("POSITION")[faces] + np.array(told["nodes"][0]["translation"])
    np.testing.assert_allclose(place, mesh.vertices[mesh.faces], atol=1e-6, rtol=0)
    uv = get("TEXCOORD_0")[faces]
    np.testing.assert_allclose(uv[..., 0], mesh.uv[..., 0], atol=1e-7)
    np.testing.assert_allclose(1 - uv[..., 1], mesh.uv[..., 1], atol=1e-7)
    np.testing.assert_allclose(get("NORMAL")[faces], mesh.vertex_normals()[mesh.faces], atol=1e-6)
    np.testing.assert_allclose(get("TANGENT")[faces], corner_tangents(mesh), atol=1e-6)
    bounds = told["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(np.float32(bounds["min"]), get("POSITION").min(0))
    np.testing.assert_array_equal(np.float32(bounds["max"]), get("POSITION").max(0))
    for view in told["bufferViews"]:
        assert view["byteOffset"] % 4 == 0


def test_vertices_are_as_few_as_can_be_and_face_outwards(stone):
    vertices = joined_vertices(stone, np.arange(4))
    assert len(vertices.position) == 12  # four charts of their own
    one = joined_vertices(Mesh(stone.vertices, stone.faces, uv=np.zeros((4, 3, 2))), np.arange(4))
    assert len(one.position) == 4
    inside_out = Mesh(stone.vertices, stone.faces[:, ::-1], stone.vertex_normals(), stone.uv)
    for mesh in (stone, inside_out):
        made = joined_vertices(mesh, np.arange(4))
        a, b, c = made.position[made.index].transpose(1, 0, 2)
        normal = made.normal[made.index].sum(1)
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), normal) > 0).all()


def test_faces_without_a_texture_stand_apart(stone):
    own = Mesh(stone.vertices, stone.faces, uv=stone.uv, texture_index=np.array([1, 0, -1, 1]))
    assert [f.tolist() for f in textured_faces(own, 2)] == [[1], [0, 3], [2]]
    assert [len(f) for f in textured_faces(stone, 2)] == [4, 0, 0]


@pytest.mark.parametrize("way", [[0, 0, -1], [0, 0, 1], [0, 1, 0], [0.3, -0.5, 0.8]])
def test_lamps_shine_where_they_are_turned_to(way):
    turned = Rotation.from_quat(turn_to(unit(way))).apply([0, 0, -1])
    assert angle(turned, unit(way)) < 1e-5


def test_lamps_give_the_object_what_ours_do(mesh):
    """A near one I/d², a far one its illuminance: both π times what a white surface shows."""
    light = Illumination(
        unit([[1, 2, 3], [0, -1, 0], [1, 0, 0]]), np.array([0.2, 0.0, 0.0]),
        np.array([[1.2, 0.6, 0.3], [0.5, 0.5, 0.5], [0, 0, 0]]), np.zeros(3, bool),
    )  # fmt: skip
    told, _ = built(mesh, light)
    near, far = told["extensions"]["KHR_lights_punctual"]["lights"]  # the dark one is none
    place = np.array(told["nodes"][1]["translation"]) - mesh.center
    np.testing.assert_allclose(place, 5 * mesh.radius * light.direction[0], rtol=1e-6)
    shown = near["intensity"] * np.array(near["color"]) / (place @ place) / np.pi
    np.testing.assert_allclose(shown, light.color[0])
    assert (near["type"], far["type"]) == ("point", "directional")
    np.testing.assert_allclose(far["intensity"] * np.array(far["color"]) / np.pi, light.color[1])
    shines = Rotation.from_quat(told["nodes"][2]["rotation"]).apply([0, 0, -1])
    np.testing.assert_allclose(shines, -light.direction[1], atol=1e-12)
    assert told["scenes"][0]["nodes"] == [0, 1, 2]
    assert "KHR_lights_punctual" in told["extensionsUsed"]


def test_images_are_embedded_or_beside(mesh):
    image = Image("stone_Specular.png", b"not really a PNG")
    material = {"specular": image, "tinted": True, "color_factor": 25.0, "specular_factor": 0.1}
    told, data = built(mesh, embed=True, **material)
    view = told["bufferViews"][told["images"][0]["bufferView"]]
    assert data[view["byteOffset"] :][: view["byteLength"]] == image.data
    assert told["images"][0]["mimeType"] == "image/png"
    assert len(told["images"]) == len(told["textures"]) == 1  # for both of its uses
    beside = json.loads(text_of(built(mesh, embed=False, **material)[0], "stone.bin"))
    assert beside["images"][0]["uri"] == image.name
    assert beside["buffers"][0]["uri"] == "stone.bin"
    specular = beside["materials"][0]["extensions"]["KHR_materials_specular"]
    assert specular == {
        "specularFactor": 0.1, "specularColorFactor": [25.0] * 3,
        "specularTexture": {"index": 0}, "specularColorTexture": {"index": 0},
    }  # fmt: skip


def test_unlit_is_nothing_but_its_colour(mesh):
    told, _ = built(mesh, base=Image("b.png", b""), rough=Image("r.png", b""), unlit=True)
    (material,) = told["materials"]
    assert material["extensions"] == {"KHR_materials_unlit": {}}
    assert len(told["images"]) == 1
