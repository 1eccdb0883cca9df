"""Filling what lies outside the charts, so that no seam shows at lower mip levels."""

from __future__ import annotations

import cv2
import numpy as np


def fill_gutters(image: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Every pixel outside gets the value of the nearest pixel inside.

    image : (H, W) or (H, W, C), any type; inside : (H, W) bool. Without any inside, unchanged.
    """
    if not inside.any() or inside.all():
        return image.copy()
    _, nearest = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    values = np.zeros((nearest.max() + 1, *image.shape[2:]), image.dtype)
    values[nearest[inside]] = image[inside]
    return np.where(inside[..., None] if image.ndim == 3 else inside, image, values[nearest])
