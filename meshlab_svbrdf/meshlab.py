"""MeshLab's own filters and layers, through pymeshlab.

check            refuse a filter that this MeshLab does not have, or a parameter it does not take
run_xml          run a one-filter script on a MeshSet
push, pull       a layer of the document ↔ a mesh of a MeshSet
fingerprint      whether a filter of MeshLab's changed a mesh
Bridge           keeps the layers of a document and the meshes of a MeshSet the same
run_on_document  one of MeshLab's filters on the layers of a document
"""

from __future__ import annotations

import difflib
import hashlib
import re
import secrets
import tempfile
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pymeshlab

from .document.document import Document
from .document.images import read_image, write_png
from .document.layers import UNOBSERVED, Layer, write_layer
from .document.mesh_files import MeshFile, read_mesh
from .errors import SvbrdfError
from .geometry.mesh import Mesh

_MeshSet = pymeshlab.MeshSet  # its own methods, also where a subclass has others
PACKAGE = Path(pymeshlab.__file__).parent


@cache
def _python_names() -> dict[str, str]:
    """PyMeshLab's name of a filter by its menu name in lower case with underscores."""
    lines = (PACKAGE / "keys.txt").read_text(encoding="utf-8").splitlines()
    return dict(words for words in map(str.split, lines) if len(words) == 2)


@cache
def _in_plugins(name: str) -> bool:
    """Whether a plugin holds that text, for the menu names that keys.txt leaves out."""
    text = b"\0" + name.encode() + b"\0"
    return any(text in plugin.read_bytes() for plugin in PACKAGE.rglob("*filter_*"))


@cache
def _spelling(name: str) -> str:
    """How the plugins write a name that differs in capitals only, or ""."""
    text = re.compile(rb"\0(" + re.escape(name.encode()) + rb")\0", re.IGNORECASE)
    found = (text.search(plugin.read_bytes()) for plugin in PACKAGE.rglob("*filter_*"))
    return next((match[1].decode() for match in found if match), "")


@cache
def _parameters(python_name: str) -> frozenset[str]:
    """The parameters of a filter, in lower case; empty where MeshLab cannot say."""
    probe = pymeshlab.MeshSet()
    probe.create_cube()
    try:
        return frozenset(probe.filter_parameter_values(python_name))
    except pymeshlab.PyMeshLabException:
        return frozenset()


def check(name: str, parameters: dict[str, str]) -> None:
    """Refuse a filter by its menu name, or a parameter, that this MeshLab does not know.

    MeshLab itself finds out when the filter is reached, and ignores unknown parameters.
    """
    key = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    python_name = _python_names().get(key)
    written = _in_plugins(name)
    if not written and (other := _spelling(name)):
        raise SvbrdfError(f"MeshLab has no filter {name!r}: it writes {other!r}")
    if python_name is None:
        if written:
            return
        from . import registry

        close = difflib.get_close_matches(name, [*registry.filters()], 1)
        hint = f", did you mean {close[0]}?" if close else ""
        raise SvbrdfError(f"neither this suite nor MeshLab has a filter {name!r}{hint}")
    known = _parameters(python_name)
    for parameter in parameters:
        if known and parameter.lower() not in known:
            raise SvbrdfError(
                f"{name} has no parameter {parameter} (its parameters: {', '.join(sorted(known))})"
            )


def run_xml(meshes: pymeshlab.MeshSet, name: str, xml: str) -> None:
    """Run a script of one filter of MeshLab's on a MeshSet."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "filter.mlx"
        path.write_text(xml, encoding="utf-8")
        try:
            _MeshSet.clear_filter_script(meshes)
            _MeshSet.load_filter_script(meshes, str(path))
            _MeshSet.apply_filter_script(meshes)
        except pymeshlab.PyMeshLabException as error:
            raise SvbrdfError(f"MeshLab's filter {name!r} failed: {str(error).strip()}") from None
        finally:
            _MeshSet.clear_filter_script(meshes)


@dataclass
class Bridge:
    """The layers of a document that a MeshSet holds.

    layers : by the mesh's id
    known : by id, what `fingerprint` said when both sides were the same
    """

    document: Document
    meshes: pymeshlab.MeshSet
    layers: dict[int, Layer] = field(default_factory=dict)
    known: dict[int, Fingerprint] = field(default_factory=dict)

    def push(self, layer: Layer) -> int:
        """Add a layer to the MeshSet; its id there."""
        identity = push(self.meshes, layer)
        self.layers[identity] = layer
        self.settle(identity)
        return identity

    def settle(self, identity: int) -> None:
        """Take the mesh as the document's layer has it."""
        self.known[identity] = fingerprint(_MeshSet.mesh(self.meshes, identity))

    def drop(self, identity: int) -> None:
        """Remove a layer's mesh from the MeshSet."""
        _MeshSet.set_current_mesh(self.meshes, identity)
        _MeshSet.apply_filter(self.meshes, "delete_current_mesh")
        del self.layers[identity], self.known[identity]

    def show(self) -> None:
        """Hide and show MeshLab's meshes as the document's layers are, after a filter of ours."""
        for identity, layer in self.layers.items():
            _MeshSet.set_mesh_visibility(self.meshes, identity, layer.visible)

    def pull(self) -> None:
        """Take what MeshLab changed into the document, as layers in memory.

        Meshes that are new become layers, meshes that are gone take theirs along.
        """
        there = {mesh.id(): mesh for mesh in _MeshSet.__iter__(self.meshes)}
        for identity in [identity for identity in self.layers if identity not in there]:
            self.document.layers.remove(self.layers.pop(identity))
            del self.known[identity]
        for identity, mesh in there.items():
            layer = self.layers.get(identity)
            if layer is None:
                layer = self.layers[identity] = Layer(mesh.label())
                self.document.layers.append(layer)
            layer.label, layer.visible = mesh.label(), mesh.is_visible()
            layer.matrix = np.array(mesh.transform_matrix())
            self._pull_content(identity, mesh, layer)

    def _pull_content(self, identity: int, mesh: pymeshlab.Mesh, layer: Layer) -> None:
        now, before = fingerprint(mesh), self.known.get(identity)
        if now == before:
            return
        old = layer.content or MeshFile(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)))
        textures = old.textures
        if before is None or now.textures != before.textures:
            textures = self._save_textures(mesh)
        content = pull(self.meshes, identity, tuple(old.vertex_attributes))
        if before is not None and now.geometry == before.geometry:
            content = replace(content, mesh=old.mesh)
        layer.content, layer.path = replace(content, textures=textures), None
        self.known[identity] = now

    def _save_textures(self, mesh: pymeshlab.Mesh) -> tuple[Path, ...]:
        """Textures that a filter of MeshLab's made or changed, as PNG files among the results."""
        folder = self.document.folder / "textures"
        folder.mkdir(parents=True, exist_ok=True)
        saved = []
        for name, image in mesh.textures().items():
            path = folder / f"{secrets.token_hex(4)}_{Path(name).stem}.png"
            image.save(str(path))
            saved.append(path)
        return tuple(saved)


class Fingerprint(NamedTuple):
    """Hashes of what a filter of MeshLab's may change in a mesh."""

    geometry: str
    looks: str
    textures: str


def fingerprint(mesh: pymeshlab.Mesh) -> Fingerprint:
    geometry = [mesh.vertex_matrix(), mesh.face_matrix(), mesh.vertex_normal_matrix()]
    if mesh.has_wedge_tex_coord():
        geometry.append(mesh.wedge_tex_coord_matrix())
    looks = [mesh.vertex_color_array()] if mesh.has_vertex_color() else []
    looks += [mesh.vertex_scalar_array()] if mesh.has_vertex_scalar() else []
    looks += [mesh.face_selection_array()] if mesh.selected_face_number() else []
    textures = hashlib.sha256()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "texture.bmp"
        for image in mesh.textures().values():
            image.save(str(path))
            textures.update(path.read_bytes())
    return Fingerprint(_hash(geometry), _hash(looks), textures.hexdigest())


def _hash(arrays: list[np.ndarray]) -> str:
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(np.ascontiguousarray(array).tobytes() + b"|")
    return sha.hexdigest()


def run_on_document(document: Document, name: str, xml: str) -> None:
    """Run one of MeshLab's filters on the user's layers of a document, the object current.

    What it changes or adds are layers in memory, which `Document.save` writes.
    """
    bridge = Bridge(document, pymeshlab.MeshSet())
    object_layer = document.object_layer()
    current = 0
    for layer in [layer for layer in document.layers if not layer.ours]:
        identity = bridge.push(layer)
        current = identity if layer is object_layer else current
    bridge.meshes.set_current_mesh(current)
    run_xml(bridge.meshes, name, xml)
    bridge.pull()


def push(meshes: pymeshlab.MeshSet, layer: Layer) -> int:
    """Add a layer to a MeshSet; its id there. Attributes become custom scalar attributes.

    In those of the suite, unobserved (NaN) is -1.
    MeshLab gets a copy of the file whose textures are PNG: the wheels read no JPEG, and a texture
    that cannot be read crashes MeshLab later. Textures that do not exist are left out.
    """
    content = layer.read()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layer.ply"
        textures = _png_textures(content, Path(folder))
        plain = replace(content, vertex_attributes={})
        write_layer(path, plain, textures=textures, double=True)
        _MeshSet.load_new_mesh(meshes, str(path))
    mesh = _MeshSet.current_mesh(meshes)
    mesh.set_label(layer.label)
    if not np.array_equal(layer.matrix, np.eye(4)):
        _MeshSet.apply_filter(meshes, "set_matrix", transformmatrix=layer.matrix, freeze=False)
    for name, values in content.vertex_attributes.items():
        if name.startswith("svbrdf_"):  # as Quality, NaN crashes MeshLab's colour ramps
            values = np.where(np.isnan(values), UNOBSERVED, values)
        mesh.add_vertex_custom_scalar_attribute(np.asarray(values, np.float64), name)
    _MeshSet.set_mesh_visibility(meshes, mesh.id(), layer.visible)
    return mesh.id()


def _png_textures(content: MeshFile, folder: Path) -> tuple[Path, ...]:
    if not all(path.is_file() for path in content.textures):
        return ()
    copies = []
    for index, path in enumerate(content.textures):
        copy = folder / f"{index}_{path.stem}.png"
        if path.suffix.lower() == ".png":
            copy.symlink_to(path)
        else:
            write_png(copy, read_image(path))
        copies.append(copy)
    return tuple(copies)


def pull(meshes: pymeshlab.MeshSet, identity: int, attributes: tuple[str, ...] = ()) -> MeshFile:
    """A mesh of a MeshSet as arrays, textures aside; `attributes` that it still has come along."""
    current = _MeshSet.current_mesh_id(meshes)
    _MeshSet.set_current_mesh(meshes, identity)
    mesh = _MeshSet.current_mesh(meshes)
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "layer.ply"
            _MeshSet.save_current_mesh(
                meshes,
                str(path),
                save_textures=False,
                binary=True,
                save_vertex_normal=True,
                save_vertex_color=mesh.has_vertex_color(),
                save_vertex_quality=mesh.has_vertex_scalar(),
            )
            content = read_mesh(path)
    finally:
        _MeshSet.set_current_mesh(meshes, current)
    values = {name: _attribute(mesh, name) for name in attributes}
    kept = {name: array for name, array in values.items() if array is not None}
    selected = mesh.face_selection_array() if mesh.selected_face_number() else None
    return replace(content, vertex_attributes=kept, textures=(), face_selected=selected)


def _attribute(mesh: pymeshlab.Mesh, name: str) -> np.ndarray | None:
    try:
        return np.array(mesh.vertex_custom_scalar_attribute_array(name))
    except pymeshlab.PyMeshLabException:
        return None
