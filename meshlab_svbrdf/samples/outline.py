"""Whether the mesh's outline lies where the picture has an edge: cameras, and the mesh, are right.

The outline and the picture's edges are compared by their directions (a doubled angle has no sign:
the object may be brighter or darker than what is behind it), at every shift of some pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy import fft

SOFT = 1.5  # pixels, by which both are blurred first
FAINT = 6.0  # codes per pixel: a gradient that counts half as an edge
REACH = 0.12  # of the image's width and height: shifts that are tried
NEAR = 2.0  # pixels around no shift that count as none


class Offset(NamedTuple):
    """shift : (2,) columns and rows, pixels, from the outline to the edges that agree best

    best, here : agreement there and within 2 pixels of no shift, -1..1
    """

    shift: np.ndarray
    best: float
    here: float

    @property
    def pixels(self) -> float:
        """How far off the outline is."""
        return float(np.hypot(*self.shift))


def outline_offset(inverse_depth: np.ndarray, image: np.ndarray) -> Offset | None:
    """How far the outline of what is seen of a mesh lies from the edges of a frame.

    Parameters
    ----------
    inverse_depth : (H, W) float, 0 where the mesh is not
    image : (H, W, 3) uint8, the frame; or its mask (H, W) bool

    Returns
    -------
    None where there is no outline in the picture.
    """
    height, width = inverse_depth.shape
    outline = _edges(255 * (inverse_depth > 0).astype(np.float32))
    total = np.abs(outline).sum()
    if total < min(height, width) / 4:
        return None
    if image.ndim == 2:
        edges = _edges(255 * image.astype(np.float32))
    else:
        channels = [_edges(image[..., k].astype(np.float32)) for k in range(3)]
        edges = np.stack(channels)[np.abs(channels).argmax(0), *np.indices((height, width))]
    # Correlate, without wrapping around
    tall, wide = (int(REACH * size) for size in (height, width))
    shape = fft.next_fast_len(height + tall), fft.next_fast_len(width + wide)
    product = fft.ifft2(fft.fft2(edges, shape) * np.conj(fft.fft2(outline, shape))).real
    agreement = np.roll(product, (tall, wide), (0, 1))[: 2 * tall + 1, : 2 * wide + 1] / total
    row, col = np.unravel_index(np.argmax(agreement), agreement.shape)
    rows, cols = np.indices(agreement.shape)
    near = np.hypot(rows - tall, cols - wide) <= NEAR
    return Offset(
        np.array([col - wide, row - tall]), float(agreement.max()), float(agreement[near].max())
    )


def _edges(image: np.ndarray) -> np.ndarray:
    """(H, W) complex: length 0..1 by the gradient's, angle twice its; none along the border."""
    soft = cv2.GaussianBlur(image, (0, 0), SOFT)
    x, y = (cv2.Sobel(soft, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    squared = (x + np.complex64(1j) * y) ** 2
    found = squared / (np.abs(squared) + FAINT**2)
    found[:3] = found[-3:] = found[:, :3] = found[:, -3:] = 0
    return found
