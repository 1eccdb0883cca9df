"""Small charts as SVG inside a page: lines, bars and dots over axes, scales of colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .html import Html, css, tag

WIDTH, HEIGHT = 420, 210
LEFT, RIGHT, TOP, BOTTOM = 44, 10, 10, 36
BINS = 60
BAR = 12
"""The height of a scale of colours."""


@dataclass(frozen=True)
class Series:
    """x, y : (n,), not finite where there is nothing; color : as CSS knows it
    kind : "line", "bars" (x has one edge more than y), "dots" or "mark" (a dashed line at each x)
    label : of the legend, or ""
    """

    x: np.ndarray
    y: np.ndarray
    color: str = "#3a7ca5"
    kind: str = "line"
    label: str = ""


def histogram(
    values: np.ndarray, color: str = "#3a7ca5", label: str = "", log: bool = False,
    limits: tuple[float, float] | None = None,
) -> Series | None:  # fmt: skip
    """Shares of the values in even bins between their .5 and 99.5 % quantiles (or `limits`); the
    rest counts at the ends. log : bins are even in the logarithm. None where no value is finite."""
    known = values[np.isfinite(values)].astype(float)
    known = known[known > 0] if log else known
    if not len(known):
        return None
    low, high = limits or np.quantile(known, [0.005, 0.995])
    scale, back = (np.log, np.exp) if log else (np.asarray, np.asarray)
    low, high = float(scale(low)), float(scale(high))
    if high - low < 1e-6 * max(abs(low), abs(high), 1e-6):
        low, high = low - 0.5, high + 0.5
    counts, edges = np.histogram(np.clip(scale(known), low, high), BINS, (low, high))
    return Series(back(edges), 100 * counts / len(known), color, "bars", label)


def chart(
    series: Sequence[Series], x_label: str, y_label: str = "", log_x: bool = False,
    y_most: float | None = None,
) -> Html:  # fmt: skip
    """The series over common axes; y begins at 0."""
    xs = np.concatenate([s.x for s in series])
    xs = xs[np.isfinite(xs) & ((xs > 0) | (not log_x))]
    ys = np.concatenate([s.y for s in series if s.kind != "mark"] or [np.ones(1)])
    ys = ys[np.isfinite(ys)]
    if not len(xs) or not len(ys):
        return tag("p", "nothing to plot", class_="missing")
    scale = np.log10 if log_x else np.asarray
    low, high = float(scale(xs.min())), float(scale(xs.max()))
    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    top = y_most or max(float(ys.max()), 1e-9) * 1.05
    wide, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def place_x(x: np.ndarray) -> np.ndarray:
        return LEFT + (scale(np.maximum(x, 1e-30) if log_x else x) - low) / (high - low) * wide

    def place_y(y: np.ndarray) -> np.ndarray:
        return TOP + tall - np.clip(y / top, -0.02, 1.02) * tall

    parts = [*_axes(place_x, place_y, (low, high), top, log_x, x_label, y_label)]
    for s in series:
        parts += _drawn(s, place_x, place_y)
    named = [s for s in series if s.label]
    for k, s in enumerate(named):
        y = TOP + 10 + 14 * k
        parts.append(tag("rect", x=WIDTH - RIGHT - 12, y=y - 8, width=10, height=8, fill=s.color))
        parts.append(tag("text", s.label, x=WIDTH - RIGHT - 16, y=y, text_anchor="end"))
    return tag("svg", *parts, view_box=f"0 0 {WIDTH} {HEIGHT}", role="img")


def color_bar(colors: np.ndarray, low: float, high: float, log: bool, label: str) -> Html:
    """What a scale of colours (n, 3) uint8 means, that runs evenly between two values or (log)
    between their logarithms."""
    scale = np.log10 if log else np.asarray
    low, high = float(scale(low)), float(scale(high))
    wide = WIDTH - LEFT - RIGHT
    step = wide / len(colors)
    parts = [
        tag("rect", x=_n(LEFT + k * step), y=0, width=_n(step + 0.5), height=BAR, fill=css(color))
        for k, color in enumerate(colors)
    ]
    for value in _log_ticks(low, high) if log else ticks(low, high):
        x = LEFT + (float(scale(value)) - low) / (high - low) * wide
        parts.append(tag("line", x1=_n(x), x2=_n(x), y1=BAR, y2=BAR + 4, stroke="#8a9096"))
        parts.append(tag("text", _told(value), x=_n(x), y=BAR + 16, text_anchor="middle"))
    parts.append(tag("text", label, x=LEFT + wide / 2, y=BAR + 32, text_anchor="middle"))
    return tag("svg", *parts, view_box=f"0 0 {WIDTH} {BAR + BOTTOM}", role="img")


def _drawn(s: Series, place_x, place_y) -> list[Html]:
    base = float(place_y(np.zeros(1))[0])
    if s.kind == "mark":
        return [
            tag("line", x1=_n(x), x2=_n(x), y1=TOP, y2=base, stroke=s.color, stroke_dasharray="4 3")
            for x in place_x(s.x)
        ]
    if s.kind == "bars":
        x, y = place_x(s.x), place_y(s.y)
        path = f"M{_n(x[0])} {_n(base)}" + "".join(
            f"V{_n(h)}H{_n(right)}" for h, right in zip(y, x[1:], strict=True)
        )
        return [tag("path", d=f"{path}V{_n(base)}Z", fill=s.color, fill_opacity=0.55)]
    known = np.isfinite(s.x) & np.isfinite(s.y)
    x, y = place_x(s.x[known]), place_y(s.y[known])
    if s.kind == "dots":
        return [
            tag("circle", cx=_n(a), cy=_n(b), r=1.6, fill=s.color)
            for a, b in zip(x, y, strict=True)
        ]
    points = "L".join(f"{_n(a)} {_n(b)}" for a, b in zip(x, y, strict=True))
    return [tag("path", d=f"M{points}", fill="none", stroke=s.color, stroke_width=1.8)]


def _axes(place_x, place_y, span, top, log_x, x_label, y_label):
    base = float(place_y(np.zeros(1))[0])
    yield tag("line", x1=LEFT, x2=WIDTH - RIGHT, y1=_n(base), y2=_n(base), stroke="#8a9096")
    for value in _log_ticks(*span) if log_x else ticks(*span):
        x = float(place_x(np.array([value]))[0])
        yield tag("line", x1=_n(x), x2=_n(x), y1=_n(base), y2=_n(base + 4), stroke="#8a9096")
        yield tag("text", _told(value), x=_n(x), y=_n(base + 16), text_anchor="middle")
    for value in ticks(0, top, 4):
        y = float(place_y(np.array([value]))[0])
        yield tag("line", x1=LEFT, x2=WIDTH - RIGHT, y1=_n(y), y2=_n(y), stroke="#e3e6e8")
        yield tag("text", _told(value), x=LEFT - 6, y=_n(y + 4), text_anchor="end")
    middle = LEFT + (WIDTH - LEFT - RIGHT) / 2
    yield tag("text", x_label, x=middle, y=HEIGHT - 4, text_anchor="middle")
    if y_label:
        at = TOP + (HEIGHT - TOP - BOTTOM) / 2
        turned = f"rotate(-90 11 {at:g})"
        yield tag("text", y_label, x=11, y=_n(at), text_anchor="middle", transform=turned)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers between two: at steps of 1, 2 or 5 times a power of ten, at most `most`."""
    raw = (high - low) / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * (1 - 1e-9))
    first = int(np.ceil(low / step - 1e-9))
    count = int(np.floor(high / step + 1e-9)) - first + 1
    return [float(f"{(first + k) * step:.10g}") for k in range(count)]


def _log_ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 of each power of ten between 10^low and 10^high; powers alone of a wide span, even
    steps of a narrow one."""
    digits = (1, 2, 5) if high - low < 2.5 else (1,)
    every = [
        float(f"{d * 10.0**e:.6g}")
        for e in range(int(np.floor(low)), int(np.ceil(high)) + 1)
        for d in digits
    ]
    found = [v for v in every if low - 1e-9 <= np.log10(v) <= high + 1e-9]
    return found if len(found) > 2 else ticks(10**low, 10**high, 4)


def _told(value: float) -> str:
    return f"{value / 1000:g}k" if abs(value) >= 10_000 else f"{value:g}"


def _n(value: float) -> str:
    return f"{value:.1f}".rstrip("0").rstrip(".")
