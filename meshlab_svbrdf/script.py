"""Chains of filters as MeshLab's filter scripts (.mlx): ours and MeshLab's, mixed.

read_script    the steps of a script
check_script   refuse unknown filters and parameters before anything runs
write_script   the inverse of read_script
run_script     run the steps on a document
"""

from __future__ import annotations

import copy
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from . import registry
from .document.atomic import replacing
from .document.document import Document, Outcome
from .document.project_xml import parse_plain
from .errors import SvbrdfError
from .progress import Show

DOCTYPE = "<!DOCTYPE FilterScript>"
RICH = {
    "bool": "RichBool",
    "int": "RichInt",
    "float": "RichFloat",
    "enum": "RichString",
    "string": "RichString",
    "path": "RichFileOpen",
    "paths": "RichString",
    "length": "RichString",
    "points": "RichString",
    "layer": "RichString",
    "rasters": "RichString",
}


@dataclass(frozen=True)
class Step:
    """One filter of a script.

    name : ours, or MeshLab's own name of a filter, as its menus show it
    parameters : by name, as text
    where : script and position, for errors
    element : the XML, handed to MeshLab as it is
    """

    name: str
    parameters: dict[str, str] = field(default_factory=dict)
    where: str = ""
    element: ET.Element | None = None

    def xml(self) -> str:
        """A script of this step alone."""
        root = ET.Element("FilterScript")
        root.append(_element(self))
        return f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"

    @property
    def ours(self) -> bool:
        return self.name in registry.filters()


def read_script(path: str | Path) -> list[Step]:
    """The steps of a filter script.

    Raises
    ------
    DocumentError : no readable XML. SvbrdfError : not a filter script, or a step without a name.
    """
    path = Path(path)
    root = parse_plain(path)
    if root.tag != "FilterScript":
        raise SvbrdfError(f"{path}: expected <FilterScript>, found <{root.tag}>")
    steps = []
    for position, element in enumerate(root, 1):
        where = f"{path}, filter {position}"
        if element.tag not in ("filter", "xmlfilter") or not element.get("name"):
            raise SvbrdfError(f'{where}: expected <filter name="…">, found <{element.tag}>')
        parameters: dict[str, str] = {}
        for param in element.iter("Param"):
            name = param.get("name", "")
            if not name or name in parameters:
                raise SvbrdfError(f"{where}: a parameter without a name, or {name!r} twice")
            parameters[name] = param.get("value", "")
        steps.append(Step(element.get("name", ""), parameters, where, element))
    return steps


def check_script(steps: list[Step]) -> None:
    """Refuse, before anything runs, unknown filters and parameters."""
    for step in steps:
        try:
            if step.ours:
                registry.get(step.name).check(dict(step.parameters))
            else:
                from . import meshlab  # it takes a second, which scripts of ours alone can spare

                meshlab.check(step.name, step.parameters)
        except SvbrdfError as error:
            raise SvbrdfError(f"{step.where}: {error}") from None


def write_script(path: str | Path, steps: list[Step]) -> None:
    """Write a filter script, whole or not at all."""
    root = ET.Element("FilterScript")
    root.extend(_element(step) for step in steps)
    ET.indent(root, " ")
    text = f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def run_script(
    document: Document,
    steps: list[Step],
    *,
    force: bool = False,
    show: Callable[[str], Show] | None = None,
    foreign: Callable[[Step], None] | None = None,
) -> Iterator[Outcome]:
    """Run the steps, one by one; nothing runs where `check_script` refuses.

    show : gives for a filter's name the function that shows its progress
    foreign : runs one of MeshLab's filters; None: on the document's layers, through pymeshlab
    """
    check_script(steps)
    with document.results.locked():
        for index, step in enumerate(steps):
            if step.ours:
                watch = show(step.name) if show else None
                anew = force or _edits_again(document, step, steps[index + 1 :])
                yield document.apply(step.name, anew, watch, **step.parameters)
                continue
            start = time.perf_counter()
            if foreign is None:
                from . import meshlab

                meshlab.run_on_document(document, step.name, step.xml())
            else:
                foreign(step)
            yield Outcome(step.name, "done by MeshLab", time.perf_counter() - start)


def _edits_again(document: Document, step: Step, later: list[Step]) -> bool:
    """Whether what the step makes was edited, and the script itself edits it: from its start."""
    edits = {product for s in later if s.ours for product in registry.get(s.name).edits}
    return any(document.edited(p) and p in edits for p in registry.get(step.name).writes)


def _element(step: Step) -> ET.Element:
    if step.element is not None and not step.ours:
        return copy.deepcopy(step.element)
    element = ET.Element("filter", name=step.name)
    kinds = {p.name: p.kind for p in registry.get(step.name).parameters} if step.ours else {}
    for name, value in step.parameters.items():
        kind = RICH[kinds.get(name, "string")]
        ET.SubElement(element, "Param", type=kind, name=name, value=value)
    return element
