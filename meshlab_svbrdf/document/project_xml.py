"""The XML of a MeshLab project: parsed without entities, written with MeshLab's DOCTYPE."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from ..errors import DocumentError
from .atomic import replacing

DOCTYPE = "<!DOCTYPE MeshLabDocument>"
DEEPEST = 100  # elements in each other; projects have 4


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
        The file is missing, malformed (with line and column), not a MeshLab project, or is refused
        by `_scout`.
    """
    root, outside = _parse(path, _Builder())
    if root.tag != "MeshLabProject":
        raise DocumentError(f"{path}: is not a MeshLab project: its root element is <{root.tag}>")
    root[:0] = [ET.Comment(text) for text in outside]
    return root


def parse_plain(path: Path) -> ET.Element:
    """The root element of any other XML file; raises as `parse_xml` does."""
    return _parse(path, ET.TreeBuilder())[0]


def _parse(path: Path, builder: ET.TreeBuilder) -> tuple[ET.Element, list[str]]:
    """The root element, and the comments around it."""
    if path.exists() and not path.is_file():
        raise DocumentError(f"{path}: is no file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        outside = _scout(data, path)
        return ET.XML(data, ET.XMLParser(target=builder)), outside
    except (expat.ExpatError, ET.ParseError, ValueError, LookupError) as error:
        raise DocumentError(f"{path}: is not well-formed XML ({error})") from None


def _scout(data: bytes, path: Path) -> list[str]:
    """The comments around the root, found before anything is expanded or built.

    Refuses entities, which can read other files or fill the memory, and elements so deep in each
    other that what walks them would fail; these files need neither.
    """
    outside: list[str] = []
    depth = 0

    def refuse(name: str, *_: object) -> None:
        raise DocumentError(f"{path}: declares the XML entity {name!r}; remove it from the DOCTYPE")

    def enter(name: str, *_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise DocumentError(
                f"{path}, line {scout.CurrentLineNumber}: <{name}> lies in {DEEPEST} other "
                "elements, which no program writes; save the file again"
            )

    def leave(*_: object) -> None:
        nonlocal depth
        depth -= 1

    scout = expat.ParserCreate()
    scout.EntityDeclHandler = refuse
    scout.StartElementHandler, scout.EndElementHandler = enter, leave
    scout.CommentHandler = lambda text: None if depth else outside.append(text)
    scout.Parse(data, True)
    return outside


def write_xml(root: ET.Element, path: Path) -> None:
    """Write a project file whole or not at all."""
    text = f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
