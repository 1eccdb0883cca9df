"""MeshLab's own filters and layers, through pymeshlab.

check            refuse a filter that this MeshLab does not have, or a parameter it does not take
run_xml          run a one-filter script on a MeshSet
pull_changes     what its filters changed, into the document
push, pull       a layer of the document ↔ a mesh of a MeshSet
fingerprint      whether a filter of MeshLab's changed a mesh
run_on_document  one of MeshLab's filters on the layers of a document
"""

from __future__ import annotations

import difflib
import hashlib
import re
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pymeshlab

from .document.document import Document
from .document.images import read_image, write_png
from .document.layers import Layer, write_layer
from .document.mesh_files import MeshFile, read_mesh
from .errors import SvbrdfError

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
    if python_name is None:
        if _in_plugins(name):
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
            pymeshlab.MeshSet.clear_filter_script(meshes)
            pymeshlab.MeshSet.load_filter_script(meshes, str(path))
            pymeshlab.MeshSet.apply_filter_script(meshes)
        except pymeshlab.PyMeshLabException as error:
            raise SvbrdfError(f"MeshLab's filter {name!r} failed: {str(error).strip()}") from None
        finally:
            pymeshlab.MeshSet.clear_filter_script(meshes)


def run_on_document(document: Document, name: str, xml: str) -> None:
    """Run one of MeshLab's filters on the user's layers of a document, the object current.

    What it changes or adds are layers in memory, which `Document.save` writes.
    """
    meshes = pymeshlab.MeshSet()
    layers = {push(meshes, layer): layer for layer in document.layers if not layer.ours}
    current = next(i for i, layer in layers.items() if layer is document.object_layer())
    meshes.set_current_mesh(current)
    before = {identity: fingerprint(meshes.mesh(identity)) for identity in layers}
    run_xml(meshes, name, xml)
    pull_changes(document, meshes, layers, before)


def pull_changes(
    document: Document,
    meshes: pymeshlab.MeshSet,
    layers: dict[int, Layer],
    before: dict[int, str],
) -> None:
    """Take what MeshLab changed into the document: `layers` by id, `before` their fingerprints.

    Meshes that are new become layers, meshes that are gone take theirs along.
    """
    there = {mesh.id(): mesh for mesh in pymeshlab.MeshSet.__iter__(meshes)}
    for identity in [identity for identity in layers if identity not in there]:
        document.layers.remove(layers.pop(identity))
        del before[identity]
    for identity, mesh in there.items():
        layer = layers.get(identity)
        if layer is None:
            layer = layers[identity] = Layer(mesh.label())
            document.layers.append(layer)
        now = fingerprint(mesh)
        if before.get(identity) == now:
            continue
        before[identity] = now
        known = layer.content.vertex_attributes if layer.content else {}
        textures = layer.content.textures if layer.content else ()
        content = pull(meshes, identity, tuple(known))
        keeps = mesh.has_wedge_tex_coord() and mesh.texture_number() == len(textures)
        layer.content = replace(content, textures=textures if keeps else ())
        layer.path, layer.matrix = None, np.array(mesh.transform_matrix())


def fingerprint(mesh: pymeshlab.Mesh) -> str:
    """SHA-256 of what a filter of MeshLab's may change in a mesh."""
    sha = hashlib.sha256()
    arrays = [mesh.vertex_matrix(), mesh.face_matrix(), mesh.transform_matrix()]
    arrays += [mesh.vertex_normal_matrix()]
    if mesh.has_wedge_tex_coord():
        arrays.append(mesh.wedge_tex_coord_matrix())
    if mesh.has_vertex_color():
        arrays.append(mesh.vertex_color_array())
    if mesh.has_vertex_scalar():
        arrays.append(mesh.vertex_scalar_array())
    for array in arrays:
        sha.update(np.ascontiguousarray(array).tobytes() + b"|")
    return sha.hexdigest()


def push(meshes: pymeshlab.MeshSet, layer: Layer) -> int:
    """Add a layer to a MeshSet; its id there. Attributes become custom scalar attributes.

    MeshLab gets a copy of the file whose textures are PNG: the wheels read no JPEG, and a texture
    that cannot be read crashes MeshLab later. Textures that do not exist are left out.
    """
    content = layer.read()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layer.ply"
        textures = _png_textures(content, Path(folder))
        plain = replace(content, vertex_attributes={})
        write_layer(path, plain, textures=textures, double=True)
        pymeshlab.MeshSet.load_new_mesh(meshes, str(path))
    mesh = pymeshlab.MeshSet.current_mesh(meshes)
    mesh.set_label(layer.label)
    if not np.array_equal(layer.matrix, np.eye(4)):
        meshes.set_matrix(transformmatrix=layer.matrix, freeze=False)
    for name, values in content.vertex_attributes.items():
        mesh.add_vertex_custom_scalar_attribute(np.asarray(values, np.float64), name)
    pymeshlab.MeshSet.set_mesh_visibility(meshes, mesh.id(), layer.visible)
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
    current = pymeshlab.MeshSet.current_mesh_id(meshes)
    pymeshlab.MeshSet.set_current_mesh(meshes, identity)
    mesh = pymeshlab.MeshSet.current_mesh(meshes)
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "layer.ply"
            pymeshlab.MeshSet.save_current_mesh(
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
        pymeshlab.MeshSet.set_current_mesh(meshes, current)
    values = {name: _attribute(mesh, name) for name in attributes}
    kept = {name: array for name, array in values.items() if array is not None}
    return replace(content, vertex_attributes=kept, textures=())


def _attribute(mesh: pymeshlab.Mesh, name: str) -> np.ndarray | None:
    try:
        return np.array(mesh.vertex_custom_scalar_attribute_array(name))
    except pymeshlab.PyMeshLabException:
        return None
