"""The XML of a MeshLab project: parsed without entities, written with MeshLab's DOCTYPE."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from ..errors import DocumentError
from .atomic import replacing

DOCTYPE = "<!DOCTYPE MeshLabDocument>"


class _Builder(ET.TreeBuilder):
    """Keeps comments, except inside groups: there MeshLab takes them for meshes and rasters."""

    def __init__(self) -> None:
        super().__init__(insert_comments=True, insert_pis=True)
        self.depth = 0

    def start(self, tag, attrs):
        self.depth += 1
        return super().start(tag, attrs)

    def end(self, tag):
        self.depth -= 1
        return super().end(tag)

    def comment(self, data):
        return super().comment(data) if self.depth < 2 else None

    def pi(self, target, data=None):
        return super().pi(target, data) if self.depth < 2 else None


def parse_xml(path: Path) -> ET.Element:
    """The root element of a project file; comments around it move inside.

    Raises
    ------
    DocumentError
        The file is missing, malformed (with line and column), not a MeshLab project, or declares
        entities: projects need none, and they can read other files or fill the memory.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror})") from error

    def refuse(name: str, *_: object) -> None:
        raise DocumentError(f"{path}: declares the XML entity {name!r}; remove it from the DOCTYPE")

    outside: list[str] = []
    depth = 0

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1

    def leave(*_: object) -> None:
        nonlocal depth
        depth -= 1

    try:
        # Look for entity declarations before anything is expanded, and for comments around the root
        scout = expat.ParserCreate()
        scout.EntityDeclHandler = refuse
        scout.StartElementHandler, scout.EndElementHandler = enter, leave
        scout.CommentHandler = lambda text: None if depth else outside.append(text)
        scout.Parse(data, True)
        root = ET.XML(data, ET.XMLParser(target=_Builder()))
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        raise DocumentError(f"{path}: is not well-formed XML ({error})") from error
    if root.tag != "MeshLabProject":
        raise DocumentError(f"{path}: is not a MeshLab project: its root element is <{root.tag}>")
    root[:0] = [ET.Comment(text) for text in outside]
    return root


def parse_plain(path: Path) -> ET.Element:
    """The root element of any other XML file; entities are refused before anything is expanded.

    Raises
    ------
    DocumentError : the file is missing, malformed, or declares entities.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror})") from None

    def refuse(name: str, *_: object) -> None:
        raise DocumentError(f"{path}: declares the XML entity {name!r}; remove it from the DOCTYPE")

    try:
        scout = expat.ParserCreate()
        scout.EntityDeclHandler = refuse
        scout.Parse(data, True)
        return ET.fromstring(data)
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        raise DocumentError(f"{path}: is not well-formed XML ({error})") from None


def write_xml(root: ET.Element, path: Path) -> None:
    """Write a project file whole or not at all."""
    text = f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
