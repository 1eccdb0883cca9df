"""Labels in and out of pictures: materials painted by the user, and a color for each to show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from skimage.color import rgb2lab

from meshlab_svbrdf.errors import SvbrdfError

# An image with more colours than this was scaled or compressed with loss, not painted.
MOST_COLORS = 256


def from_image(
    images: Sequence[np.ndarray],
    texture: np.ndarray,
    row: np.ndarray,
    col: np.ndarray,
    sizes: Sequence[tuple[int, int]],
) -> tuple[np.ndarray, np.ndarray]:
    """Labels that the user painted in texture space, one image per texture.

    Parameters
    ----------
    images : (h, w) grey ids, (h, w, 3) colours or (h, w, 4) with 0 alpha for "none"; uint8 or
        uint16, the same for all; any size, read at the texels' centres without interpolation.
        Grey 255 (8 bit) and 65535 (16 bit) mean none.
    texture, row, col : (T,) int, a texel's texture image and its pixel; row 0 is v = 1
    sizes : (height, width) of each texture that row and col count in

    Returns
    -------
    labels : (T,) int32 from 0, by rising id or colour; −1 where none
    table : (M,) the ids, or (M, 3) the colours, as they are in the images

    Raises
    ------
    SvbrdfError : not one image per texture, not all alike, not integer, or too many colours
    """
    images = [_checked(image, index) for index, image in enumerate(images)]
    if len(images) != len(sizes):
        raise SvbrdfError(
            f"{len(images)} material image(s) for {len(sizes)} texture(s): give one per texture"
        )
    if len({(image.dtype, image.shape[2:]) for image in images}) > 1:
        raise SvbrdfError(
            "the material images differ in depth or channels: save all as 8-bit or 16-bit grey, "
            "or all as colours"
        )

    # Read each texel's pixel
    values = np.empty((len(row), *images[0].shape[2:]), images[0].dtype)
    for index, (image, (height, width)) in enumerate(zip(images, sizes, strict=True)):
        inside = texture == index
        y = (2 * row[inside].astype(np.int64) + 1) * image.shape[0] // (2 * height)
        x = (2 * col[inside].astype(np.int64) + 1) * image.shape[1] // (2 * width)
        values[inside] = image[y, x]

    if values.ndim == 1:
        some = values != np.iinfo(values.dtype).max
    else:
        some = values[:, 3] > 0 if values.shape[1] == 4 else np.ones(len(values), bool)
        values = values[:, :3]
    table, compact = np.unique(values[some], axis=0, return_inverse=True)
    if values.ndim == 2 and len(table) > MOST_COLORS:
        raise SvbrdfError(
            f"the material image holds {len(table)} colours, expected at most {MOST_COLORS}: save "
            "it as PNG, painted without soft edges"
        )
    labels = np.full(len(row), -1, np.int32)
    labels[some] = compact.reshape(-1)
    return labels, table


def palette(count: int) -> np.ndarray:
    """Colours that are told apart at a glance, the first n the same for every count.

    Each is the one of a coarse RGB grid farthest in CIE Lab from black, white, grey and those
    before it. Returns (count, 3) uint8 sRGB; from 1000 on they repeat.
    """
    level = np.linspace(0, 255, 10).round().astype(np.uint8)
    grid = np.stack(np.meshgrid(level, level, level, indexing="ij"), -1).reshape(-1, 3)
    lab = rgb2lab(grid)
    avoided = rgb2lab(np.array([[0, 0, 0], [128, 128, 128], [255, 255, 255]], np.uint8))
    distance = np.linalg.norm(lab[:, None] - avoided, axis=2).min(1)
    chosen: list[int] = []
    for _ in range(min(count, len(grid))):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
        distance[chosen[-1]] = -1
    return np.resize(grid[chosen], (count, 3))


def _checked(image: np.ndarray, index: int) -> np.ndarray:
    """The image without a superfluous axis; what it is not good for, said."""
    image = np.asarray(image)
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    grey_or_color = image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (3, 4))
    if not grey_or_color or image.dtype not in (np.uint8, np.uint16) or image.size == 0:
        raise SvbrdfError(
            f"material image {index}: expected 8-bit or 16-bit ids (grey) or colours, got "
            f"{image.dtype} of shape {image.shape}"
        )
    return image
