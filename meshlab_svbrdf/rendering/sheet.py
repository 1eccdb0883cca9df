"""Pictures side by side, each with its title, as figures show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

PAPER, INK = (255, 255, 255), (20, 20, 20)
GAP = 4
BAR = 10


class Panel(NamedTuple):
    """image : (H, W, 3) uint8; title : one line above it; scale : colours (n, 3) from the bottom
    to the top of a bar beside it, and the values at both ends; or None"""

    image: np.ndarray
    title: str
    scale: tuple[np.ndarray, str, str] | None = None


def sheet(rows: Sequence[Sequence[Panel]]) -> np.ndarray:
    """Rows of panels of one height each, under each other, (H, W, 3) uint8 on white."""
    if not rows or not all(rows):
        raise ValueError("a sheet needs rows, and every row a panel")
    made = [_row(row) for row in rows]
    width = max(row.shape[1] for row in made)
    wide = [
        np.pad(row, ((0, GAP), (0, width - row.shape[1]), (0, 0)), constant_values=255)
        for row in made
    ]
    return np.concatenate(wide)


def _row(panels: Sequence[Panel]) -> np.ndarray:
    heights = {panel.image.shape[0] for panel in panels}
    if len(heights) > 1:
        raise ValueError(f"panels of a row have one height, found {sorted(heights)}")
    height = heights.pop()
    narrowest = min(panel.image.shape[1] for panel in panels)
    letters = int(np.clip(min(height / 22, narrowest / 11), 10, 22))
    font, head = ImageFont.load_default(letters), 2 * letters
    ticks = [
        max(font.getlength(text) for text in panel.scale[1:]) + BAR + 3 * GAP if panel.scale else 0
        for panel in panels
    ]
    widths = [panel.image.shape[1] + round(t) for panel, t in zip(panels, ticks, strict=True)]
    sheet = Image.new("RGB", (sum(widths) + GAP * (len(panels) - 1), head + height), PAPER)
    draw, left = ImageDraw.Draw(sheet), 0
    for panel, width in zip(panels, widths, strict=True):
        title = _fitting(panel.title, width, font)
        middle = left + panel.image.shape[1] / 2
        draw.text((middle, letters), title, INK, font, anchor="mm")
        sheet.paste(Image.fromarray(panel.image), (left, head))
        if panel.scale is not None:
            colors, low, high = panel.scale
            at = left + panel.image.shape[1] + GAP
            rising = np.linspace(len(colors) - 1, 0, height).round().astype(int)
            bar = np.repeat(colors[rising][:, None], BAR, 1)
            sheet.paste(Image.fromarray(bar), (at, head))
            draw.text((at + BAR + GAP, head), high, INK, font, anchor="lt")
            draw.text((at + BAR + GAP, head + height), low, INK, font, anchor="lb")
        left += width + GAP
    return np.asarray(sheet)


def _fitting(text: str, width: float, font: ImageFont.ImageFont | ImageFont.FreeTypeFont) -> str:
    """The text, cut where it would be wider than its panel."""
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"
