"""The clusters of texels: read, written, and shown as the layer `materials`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import texture_files
from meshlab_svbrdf.document.layers import Layer
from meshlab_svbrdf.document.mesh_files import MeshFile
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.reflectance.edit import pick
from meshlab_svbrdf.reflectance.labels import palette

from ._maps import set_texture


def read_labels(document: Document) -> np.ndarray:
    """(T,) int32, -1 for none."""
    return document.attribute("material").astype(np.int32)


def cluster_at(point: np.ndarray, texels: Texels, labels: np.ndarray) -> int:
    """The cluster at a point (3,) of the world; SvbrdfError where there is none."""
    cluster = int(labels[pick(texels.position, point - texels.center)])
    if cluster < 0:
        raise SvbrdfError(
            f"the object is unobserved at {point.tolist()}, and belongs to no cluster there: "
            "pick another point"
        )
    return cluster


def set_labels(document: Document, texels: Texels, labels: np.ndarray) -> str:
    """Stage attribute, maps/material.png and the layer; what there is, in words."""
    document.set_attribute("material", labels.astype(np.int32))
    count = int(labels.max(initial=-1)) + 1
    kind, none = (np.uint8, 255) if count <= 255 else (np.uint16, 65535)
    ids = np.where(labels >= 0, labels, none).astype(kind)
    document.set_map("material", texels.to_images(ids, none), kind="png")

    # Show the clusters in distinct colours
    used = np.unique(labels[labels >= 0])
    rank = np.where(labels >= 0, np.searchsorted(used, labels), -1)
    colors = np.vstack([palette(len(used)), [[60, 60, 60]]]).astype(np.uint8)[rank]
    set_texture(document, "materials_shown", texels, colors)
    layer = document.object_layer()
    mesh = document.mesh()
    local = replace(layer.read().mesh, uv=mesh.uv, texture_index=mesh.texture_index)
    shown = document.folder / "maps" / "materials_shown.png"
    textures = tuple(texture_files(shown, len(texels.sizes)))
    document.set_layer(
        Layer("materials", None, layer.matrix, False, MeshFile(mesh=local, textures=textures))
    )
    return f"{len(used)} clusters, {100 * np.mean(labels >= 0):.1f} % of the texels"
