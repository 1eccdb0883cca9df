"""The report's words on the run: facts, remarks, what ran with which parameters, versions."""

from __future__ import annotations

import platform
from collections import Counter
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from meshlab_svbrdf import registry
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.freshness import in_words
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.reporting.html import Html, join, note, section, table, tag

from ._lights import doubt

LIBRARIES = (
    "meshlab-svbrdf", "numpy", "scipy", "numba", "opencv-contrib-python-headless", "scikit-image",
    "colour-science", "pymeshlab", "OpenEXR", "pillow", "av", "embreex", "KDEpy", "xatlas",
)  # fmt: skip


def facts(document: Document) -> Html:
    """The result in a few numbers."""
    pairs = (tag("div", tag("dt", name), tag("dd", value)) for name, value in figures(document))
    return tag("dl", *pairs, class_="facts")


def figures(document: Document) -> list[tuple[str, str]]:
    """Those numbers and what they are called."""
    told: list[tuple[str, str]] = []
    rasters, held = len(document.project.rasters), len(document.held_out)
    count = f"{rasters:,}"
    if document.has_json("frames"):
        used = sum("samples" in frame for frame in document.json("frames")["frames"])
        count = count if used == rasters else f"{used:,} of {count}"
    told.append(("frames", count + (f", {held} held out" if held else "")))
    if document.has("texels"):
        told.append(("texels", f"{len(document.array('texels_face', mmap=True)):,}"))
    if document.has("diffuse"):
        known = np.isfinite(document.attribute("diffuse")).all(1)
        told.append(("observed", f"{100 * known.mean():.1f} %"))
    if document.has("lights"):
        told.append(("lights", str(len(document.json("lights")["lights"]))))
    if document.has("material_specular"):
        materials = document.json("materials")["materials"]
        seen = sum(m["observed"] for m in materials)
        told.append(("materials", f"{len(materials)}, gloss of {seen} observed"))
    runs = document.results.record["runs"].values()
    told.append(("time of all filters", f"{sum(run['seconds'] for run in runs):.1f} s"))
    return told


def warnings(document: Document) -> Html:
    """What a reader of the figures has to know."""
    items = [tag("li", text) for text in remarks(document)]
    return section("Remarks", tag("ul", *items) if items else note("None."))


def remarks(document: Document) -> list[str]:
    """The same, a sentence each."""
    record, found = document.results.record, []
    for product, entry in record["products"].items():
        if older := document.stale(product):
            found.append(
                f"The {in_words(product)} is older than the {in_words(older)}: run "
                f"{entry['filter']} again."
            )
        if document.edited(product):
            found.append(f"The {in_words(product)} was edited by hand.")
    if not document.held_out:
        found.append("No frame is held out: nothing here was judged by frames it had not seen.")
    if document.has("lights") and document.json("lights")["lights"] and (why := doubt(document)):
        found.append(f"Do not trust the lights: {why}.")
    if document.has("material_specular"):
        told = document.json("materials")
        for m in told["materials"]:
            if not m["observed"]:
                found.append(f"Material {m['id']}: gloss unobserved: {m['reason']}.")
        found += [f"{text[:1].upper()}{text[1:]}." for text in told.get("notes", ())]
    if document.has_json("frames"):
        reasons = Counter(
            frame["left_out"] for frame in document.json("frames")["frames"] if "left_out" in frame
        )
        found += [f"{count} frames left out: {reason}." for reason, count in reasons.items()]
    return found


def runs(document: Document) -> Html:
    """What ran, when, how long, with what outcome; and what of the default chain did not."""
    record = document.results.record["runs"]
    rows = [
        (
            name, f"{run['seconds']:.1f}", f"{run['cpu_seconds']:.1f}",
            run.get("date", "")[:16].replace("T", " "), run.get("message", ""),
        )
        for name, run in record.items()
    ]  # fmt: skip
    rows += [
        (step.name, "–", "–", "", "not run") for step in chain() if step.name not in record
    ]  # fmt: skip
    return section(
        "What ran", table(("filter", "s", "CPU s", "date", "outcome"), rows, 4)
    )  # fmt: skip


def parameters(document: Document) -> Html:
    """Every parameter of every run; what is not the default is bold."""
    rows = []
    known = registry.filters()
    for name, run in document.results.record["runs"].items():
        defaults = {p.name: p.default for p in known[name].parameters} if name in known else {}
        given = []
        for key, value in run["parameters"].items():
            text = f"{key}={'' if value is None else value}"
            plain = value in (None, "") if defaults.get(key) == "" else value == defaults.get(key)
            given += [text if plain else tag("strong", text), " · "]
        rows.append((name, str(run.get("version", "")), join(given[:-1])))
    said = note("Those in bold are not the defaults.")
    return section("Parameters", said, table(("filter", "version", "parameters"), rows, 2))


def versions(document: Document) -> Html:
    """The software, and the names of the results: what they were made from, as one word each."""
    found = [("Python", f"{platform.python_version()}, {platform.system()}")]
    for name in LIBRARIES:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            found.append((name, "not installed"))
    keys = [
        (product, entry["filter"], entry["key"][:16])
        for product, entry in document.results.record["products"].items()
    ]
    return section(
        "Versions", note("The software that wrote this page."),
        table(("software", "version"), found), tag("h3", "Results"),
        note("A key names a result by what it was made from: the same inputs give the same key."),
        table(("result", "filter", "key"), keys),
    )  # fmt: skip
