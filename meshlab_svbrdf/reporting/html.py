"""HTML that is escaped unless it was made here, and a page that needs nothing but itself.

tag, table, picture, section   parts; any text in them is escaped
page                           all of it, with its style, for screen, telephone and paper
"""

from __future__ import annotations

import base64
import html
import unicodedata
from collections.abc import Iterable, Sequence

import cv2
import numpy as np

VOID = ("br", "img", "meta", "path", "line", "circle", "rect")
JPEG_QUALITY = 88

STYLE = """
:root { --ink: #1c1e21; --dim: #5f666d; --line: #d5d9dd; --tint: #f3f5f6; --warn: #8a4b00; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 74rem; padding: 1.5rem 1rem 4rem; color: var(--ink);
  background: #fff; font: 16px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .5rem; border-top: 2px solid; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p { margin: .4rem 0; max-width: 46rem; }
.dim { color: var(--dim); }
.missing, .warn { color: var(--warn); }
.grid { display: grid; gap: 1rem; margin: .8rem 0;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 21rem), 1fr)); }
.strip { display: grid; gap: .5rem; margin: .8rem 0;
  grid-template-columns: repeat(auto-fit, minmax(min(46%, 11rem), 1fr)); }
.few { max-width: 32rem; }
.small { width: 9rem; } .small figcaption { display: none; } .small figure img { width: auto;
  max-width: 100%; margin: auto; }
td p { margin: 0 0 .3rem; }
figure { margin: 0; break-inside: avoid; }
figure img, figure svg { display: block; width: 100%; height: auto; }
figcaption { font-size: .82rem; color: var(--dim); margin-top: .2rem; }
/* A shadow at an edge beyond which a table goes on */
.wide { overflow-x: auto; margin: .6rem 0; background:
  linear-gradient(90deg, #fff 30%, #fff0) 0 0 / 2.5rem 100% no-repeat local,
  linear-gradient(270deg, #fff 30%, #fff0) 100% 0 / 2.5rem 100% no-repeat local,
  linear-gradient(90deg, #0004, #0000) 0 0 / .8rem 100% no-repeat scroll,
  linear-gradient(270deg, #0004, #0000) 100% 0 / .8rem 100% no-repeat scroll; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem .28rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); white-space: nowrap; }
th { color: var(--dim); font-weight: 600; }
td.long { min-width: 15rem; white-space: normal; overflow-wrap: anywhere; }
dl.facts { display: grid; grid-template-columns: repeat(auto-fill, minmax(8.5rem, 1fr));
  gap: .7rem; margin: 1.2rem 0; }
dl.facts div { background: var(--tint); padding: .5rem .7rem; border-radius: .3rem; }
dt { font-size: .8rem; color: var(--dim); }
dd { margin: 0; font-size: 1.05rem; font-weight: 600; overflow-wrap: anywhere; }
.swatch { display: inline-block; width: .9em; height: .9em; margin-right: .4em;
  vertical-align: -.1em; border: 1px solid var(--dim); }
svg text { font: 11px system-ui, sans-serif; fill: var(--dim); }
@page { size: A4; margin: 15mm 14mm; }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  h2, h2 + p, h3 { break-after: avoid; } tr { break-inside: avoid; }
  .grid { grid-template-columns: 1fr 1fr; }
  .strip { grid-template-columns: repeat(auto-fit, minmax(27mm, 1fr)); }
  .wide { overflow: visible; background: none; }
  table { font-size: 7.5pt; } th { white-space: normal; }
  td.long { min-width: 0; }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
}
"""


class Html(str):
    """A text that is HTML already; every other text is escaped."""


def escape(value: object) -> Html:
    """Anything as HTML: its text escaped, without control characters; `Html` as it is."""
    if isinstance(value, Html):
        return value
    text = "".join(
        "\ufffd" if unicodedata.category(c) in ("Cc", "Cs") and c not in "\n\t" else c
        for c in str(value)
    )
    return Html(html.escape(text))


def tag(element: str, /, *children: object, **attributes: object) -> Html:
    """An element. `class_` is class, `view_box` viewBox, other underscores are hyphens."""
    names = {"class_": "class", "view_box": "viewBox"}
    given = "".join(
        f' {names.get(key, key.replace("_", "-"))}="{escape(str(value))}"'
        for key, value in attributes.items()
    )
    if element in VOID:
        return Html(f"<{element}{given}/>")
    return Html(f"<{element}{given}>{''.join(map(escape, children))}</{element}>")


def join(parts: Iterable[object]) -> Html:
    """One after the other."""
    return Html("".join(map(escape, parts)))


def table(headings: Sequence[object], rows: Iterable[Sequence[object]], *long: int) -> Html:
    """A table that scrolls by itself where it is too wide; long : columns of prose."""
    head = tag("tr", *(tag("th", heading) for heading in headings))
    body = (
        tag("tr", *(_cell(value, k in long) for k, value in enumerate(row))) for row in rows
    )  # fmt: skip
    whole = tag("table", tag("thead", head), tag("tbody", *body))
    return tag("div", whole, class_="wide")


def _cell(value: object, long: bool) -> Html:
    return tag("td", value, class_="long") if long else tag("td", value)


def picture(image: np.ndarray, caption: str, most: int = 640) -> Html:
    """An image (H, W, 3) uint8 in at most so many columns and rows, inside the page."""
    scale = min(most / max(image.shape[:2]), 1)
    if scale < 1:
        size = tuple(max(round(scale * n), 1) for n in image.shape[1::-1])
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    how = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), how)
    source = "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
    height, width = image.shape[:2]
    shown = tag("img", src=source, alt=caption, width=width, height=height)
    return tag("figure", shown, tag("figcaption", caption))


def css(color: np.ndarray) -> str:
    """A colour (3,) uint8 as CSS knows it."""
    return "#" + "".join(f"{int(c):02x}" for c in color)


def figure(drawing: Html, caption: str) -> Html:
    return tag("figure", drawing, tag("figcaption", caption))


def section(title: str, *parts: object) -> Html:
    return tag("section", tag("h2", title), *parts)


def note(text: object, kind: str = "dim") -> Html:
    """A paragraph; kind : "dim", "missing" or "warn"."""
    return tag("p", text, class_=kind)


def page(title: str, parts: Iterable[object]) -> str:
    """A whole document. Its policy forbids whatever does not lie in it."""
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(STYLE)),
    )
    body = tag("body", *parts)
    return f"<!DOCTYPE html>\n{tag('html', head, body, lang='en')}\n"
