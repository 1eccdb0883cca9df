"""glTF 2.0 and its binary form, GLB: the object, its materials, and the lamps around it.

Units: a lamp in whose light a white surface shows c has the illuminance π c (lux) at the object,
KHR_lights_punctual; positions are the world's.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..rendering.environment_lights import Illumination
from .corners import Vertices

FLOAT, UNSIGNED = 5126, 5125
ARRAY, ELEMENTS = 34962, 34963
LINEAR, MIPMAPS, CLAMP = 9729, 9987, 33071
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
IMAGE_TYPES = {".png": "image/png", ".jpg": "image/jpeg"}


@dataclass(frozen=True)
class Image:
    """name : the file's; data : PNG or JPEG"""

    name: str
    data: bytes


@dataclass(frozen=True)
class Material:
    """A texture's material.

    base, rough, specular, normal : images; None: there is none
    factors : of `maps.GltfMaps`
    unlit : whether the base colour is shown as it is
    """

    name: str
    base: Image | None = None
    base_factor: float = 1.0
    rough: Image | None = None
    rough_factor: float = 1.0
    specular: Image | None = None
    specular_factor: float = 0.0
    color_factor: float = 1.0
    tinted: bool = False
    normal: Image | None = None
    unlit: bool = False


class Builder:
    """glTF's JSON and its one buffer, part by part.

    embed : whether images go into the buffer (GLB); else they are files beside the JSON
    """

    def __init__(self, name: str, embed: bool) -> None:
        self.name, self.embed = name, embed
        self.parts: list[bytes] = []
        self.length = 0
        self.images: list[Image] = []
        self.used: set[str] = set()
        self.json: dict[str, Any] = {
            key: [] for key in ("nodes", "meshes", "materials", "textures", "images", "samplers",
                                "accessors", "bufferViews")
        }  # fmt: skip

    def view(self, data: bytes, target: int | None = None) -> int:
        """Add to the buffer, at a multiple of four."""
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": self.length, "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        padded = data + b"\0" * (-len(data) % 4)
        self.parts.append(padded)
        self.length += len(padded)
        return self._add("bufferViews", entry)

    def accessor(self, values: np.ndarray, target: int, bounds: bool = False) -> int:
        """(N, 2 to 4) float32, or (N,) uint32."""
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
        entry: dict[str, Any] = {
            "bufferView": self.view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": FLOAT if values.dtype == np.float32 else UNSIGNED,
            "count": len(values),
            "type": kind[1 if values.ndim == 1 else values.shape[1]],
        }
        if bounds:
            entry |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self._add("accessors", entry)

    def texture(self, image: Image) -> dict[str, int]:
        """A reference to an image as a texture, each image once."""
        names = [known.name for known in self.images]
        if image.name in names:
            return {"index": names.index(image.name)}
        self.images.append(image)
        entry: dict[str, Any] = {"name": image.name.rpartition(".")[0]}
        if self.embed:
            suffix = image.name[image.name.rindex(".") :]
            entry |= {"mimeType": IMAGE_TYPES[suffix], "bufferView": self.view(image.data)}
        else:
            entry["uri"] = image.name
        if not self.json["samplers"]:
            self._add("samplers", {"magFilter": LINEAR, "minFilter": MIPMAPS,
                                   "wrapS": CLAMP, "wrapT": CLAMP})  # fmt: skip
        self._add("images", entry)
        return {"index": self._add("textures", {"sampler": 0, "source": len(self.images) - 1})}

    def material(self, material: Material, two_sided: bool) -> int:
        """A material by metallic-roughness and KHR_materials_specular, or unlit."""
        grey = [material.base_factor] * 3
        pbr: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": material.rough_factor}
        if material.base is not None:
            pbr["baseColorTexture"] = self.texture(material.base)
        if material.base_factor != 1:
            pbr["baseColorFactor"] = [*grey, 1.0]
        entry: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": pbr}
        if two_sided:
            entry["doubleSided"] = True
        if material.unlit:
            entry["extensions"] = self._extension("KHR_materials_unlit", {})
        else:
            if material.rough is not None:
                pbr["metallicRoughnessTexture"] = self.texture(material.rough)
            if material.normal is not None:
                entry["normalTexture"] = self.texture(material.normal)
            told = self._specular(material)
            entry["extensions"] = self._extension("KHR_materials_specular", told)
        return self._add("materials", entry)

    def primitive(self, vertices: Vertices, material: int) -> dict[str, Any]:
        downwards = vertices.uv.copy()  # images begin at the top
        downwards[:, 1] = 1 - downwards[:, 1]
        attributes = {
            "POSITION": self.accessor(vertices.position, ARRAY, bounds=True),
            "NORMAL": self.accessor(vertices.normal, ARRAY),
            "TEXCOORD_0": self.accessor(downwards, ARRAY),
        }
        if vertices.tangent is not None:
            attributes["TANGENT"] = self.accessor(vertices.tangent, ARRAY)
        index = self.accessor(vertices.index.ravel(), ELEMENTS)
        return {"attributes": attributes, "indices": index, "material": material}

    def object(self, primitives: Sequence[dict[str, Any]], center: np.ndarray) -> None:
        mesh = self._add("meshes", {"name": self.name, "primitives": list(primitives)})
        self._add("nodes", {"name": self.name, "mesh": mesh, "translation": center.tolist()})

    def lamps(self, light: Illumination, center: np.ndarray, radius: float) -> None:
        """A node for each light, all of KHR_lights_punctual."""
        entries: list[dict[str, Any]] = []
        for k in range(len(light)):
            brightest = float(light.color[k].max())
            if not brightest > 0:
                continue
            name = f"lamp {len(entries)}"
            entry: dict[str, Any] = {
                "name": name, "type": "directional", "intensity": float(np.pi * brightest),
                "color": (light.color[k] / brightest).tolist(),
            }  # fmt: skip
            node: dict[str, Any] = {"name": name}
            if light.curvature[k] > 0:
                distance = radius / light.curvature[k]
                entry["type"] = "point"
                entry["intensity"] *= float(distance**2)
                node["translation"] = (center + distance * light.direction[k]).tolist()
            else:
                node["rotation"] = turn_to(-light.direction[k]).tolist()
            node["extensions"] = self._extension("KHR_lights_punctual", {"light": len(entries)})
            entries.append(entry)
            self._add("nodes", node)
        if entries:
            self.json["extensions"] = {"KHR_lights_punctual": {"lights": entries}}

    def finish(self, generator: str, extras: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """The JSON, whose buffer has no uri, and the buffer."""
        data = b"".join(self.parts)
        found = {key: value for key, value in self.json.items() if value}
        nodes = list(range(len(found["nodes"])))
        found |= {
            "asset": {"version": "2.0", "generator": generator, "extras": extras},
            "scene": 0,
            "scenes": [{"name": self.name, "nodes": nodes}],
            "buffers": [{"byteLength": len(data)}],
        }
        if self.used:
            found["extensionsUsed"] = sorted(self.used)
        return found, data

    def _specular(self, material: Material) -> dict[str, Any]:
        told: dict[str, Any] = {"specularFactor": material.specular_factor}
        if material.color_factor != 1:
            told["specularColorFactor"] = [material.color_factor] * 3
        if material.specular is not None:
            told["specularTexture"] = self.texture(material.specular)
            if material.tinted:
                told["specularColorTexture"] = self.texture(material.specular)
        return told

    def _extension(self, name: str, content: dict[str, Any]) -> dict[str, Any]:
        self.used.add(name)
        return {name: content}

    def _add(self, key: str, entry: dict[str, Any]) -> int:
        self.json[key].append(entry)
        return len(self.json[key]) - 1


def turn_to(direction: np.ndarray) -> np.ndarray:
    """The quaternion (x, y, z, w) that turns −Z, where glTF's lights shine, to a direction."""
    start = np.array([0.0, 0.0, -1.0])
    w = 1 + float(start @ direction)
    if w < 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.append(np.cross(start, direction), w)
    return quaternion / np.linalg.norm(quaternion)


def text_of(told: dict[str, Any], binary: str) -> bytes:
    """The file NAME.gltf, whose buffer is the file `binary`."""
    buffers = [told["buffers"][0] | {"uri": binary}]
    return json.dumps(told | {"buffers": buffers}, indent=1, allow_nan=False).encode()


def glb_of(told: dict[str, Any], data: bytes) -> bytes:
    """The file NAME.glb."""
    text = json.dumps(told, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
    chunks += struct.pack("<II", len(data), BINARY_CHUNK) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
