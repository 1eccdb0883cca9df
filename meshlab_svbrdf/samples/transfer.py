"""Transfer functions: what a frame's numbers say of linear light, 1 being white.

    encode, decode     linear light to signal 0..1, and back
    light_of           a frame's pixels to linear light
    clip_level         the light from which its pixels may have been brighter

sRGB is our own; the others are colour-science's (Mansencal et al.). Camera logs and Rec. 709 give
the light of the scene, a perfect white diffuser being 1; PQ gives the light of its display, 203
cd/m² being 1, and HLG the scene's, a signal of 75 % being 1 (BT.2408).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from . import luminance

AUTO, LINEAR, SRGB, ESTIMATE = "auto", "linear", "srgb", "estimate"
LOGS = {
    "acescc": "ACEScc", "acescct": "ACEScct", "applelog": "Apple Log Profile",
    "arrilogc3": "ARRI LogC3", "arrilogc4": "ARRI LogC4", "canonlog": "Canon Log",
    "canonlog2": "Canon Log 2", "canonlog3": "Canon Log 3", "cineon": "Cineon", "dlog": "D-Log",
    "flog": "F-Log", "flog2": "F-Log2", "llog": "L-Log",
    "log3g10": "Log3G10", "log3g12": "Log3G12", "milog": "Mi-Log", "nlog": "N-Log",
    "panalog": "Panalog", "protune": "Protune", "redlog": "REDLog", "redlogfilm": "REDLogFilm",
    "slog": "S-Log", "slog2": "S-Log2", "slog3": "S-Log3", "tlog": "T-Log", "vlog": "V-Log",
    "viperlog": "ViperLog",
}  # fmt: skip
"""Our names of colour-science's log curves."""
TRANSFERS = (SRGB, LINEAR, "rec709", "pq", "hlg", *LOGS)

PQ_WHITE = 203.0  # cd/m²
HLG_WHITE = 0.26496256042100724  # what a signal of .75 stands for
REC2020_TO_REC709 = np.array(
    [
        [1.660491, -0.587641, -0.072850],
        [-0.124550, 1.132900, -0.008349],
        [-0.018151, -0.100579, 1.118730],
    ]
)
"""Linear colours of BT.2020's primaries in those of sRGB (BT.2087)."""
CLIPPED_8, CLIPPED_16 = 254 / 255, 65470 / 65535
"""Signals from which a pixel may have been brighter: the last code but one of 8 bits; of 16 the
last one of a video of 10."""
CLIPPED_MEAN = 250 / 255
"""The same of the mean of several pixels, of which one alone may have been clipped."""


def decode(signal: np.ndarray, transfer: str) -> np.ndarray:
    """Linear light of a signal in 0..1, float64; never negative. Inverse of `encode`."""
    signal = np.asarray(signal, np.float64)
    if transfer == LINEAR:
        return signal
    if transfer == SRGB:
        return luminance.decode(signal)
    import colour.models as models  # takes a second

    with np.errstate(all="ignore"):  # of several pieces, each is computed everywhere
        if transfer == "rec709":
            light = models.oetf_inverse_BT709(signal)
        elif transfer == "pq":
            light = models.eotf_ST2084(signal) / PQ_WHITE
        elif transfer == "hlg":
            light = models.oetf_inverse_BT2100_HLG(signal) / HLG_WHITE
        else:
            light = models.log_decoding(signal, function=LOGS[transfer])
    return np.maximum(light, 0)


def encode(light: np.ndarray, transfer: str) -> np.ndarray:
    """The signal, 0..1 where the curve reaches so far, of linear light."""
    light = np.asarray(light, np.float64)
    if transfer == LINEAR:
        return light
    if transfer == SRGB:
        return luminance.encode(light)
    import colour.models as models

    with np.errstate(all="ignore"):
        if transfer == "rec709":
            return np.asarray(models.oetf_BT709(light))
        if transfer == "pq":
            return np.asarray(models.eotf_inverse_ST2084(light * PQ_WHITE))
        if transfer == "hlg":
            return np.asarray(models.oetf_BT2100_HLG(light * HLG_WHITE))
        return np.asarray(models.log_encoding(light, function=LOGS[transfer]))


@cache
def _table(transfer: str, codes: int) -> np.ndarray:
    return decode(np.arange(codes) / (codes - 1), transfer).astype(np.float32)


def light_of(
    pixels: np.ndarray,
    transfer: str,
    *,
    wide_gamut: bool = False,
    response: np.ndarray | None = None,
) -> np.ndarray:
    """Linear light, (H, W, 3) float32, of sRGB's primaries.

    Parameters
    ----------
    pixels : (H, W, 3) uint8 or uint16, coded; or float, which is linear light already
    transfer : of coded pixels, one of TRANSFERS
    wide_gamut : the primaries are BT.2020's; what lies outside of sRGB's is clipped to its gamut
    response : (256, 3), the light of each code of 8 bits, in place of a transfer function
    """
    if pixels.dtype.kind == "f":
        light = pixels.astype(np.float32)
    elif response is not None:
        light = np.stack([response[pixels[..., k], k] for k in range(3)], -1).astype(np.float32)
    else:
        light = _table(transfer, 1 << (8 * pixels.itemsize))[pixels]
    if wide_gamut:
        light = np.maximum(light @ REC2020_TO_REC709.T.astype(np.float32), 0)
    return light


def clip_level(
    kind: np.dtype,
    transfer: str,
    *,
    clip: float = 0.0,
    mean: bool = False,
    response: np.ndarray | None = None,
) -> float:
    """The light from which a channel may have been brighter; infinite where nothing is clipped.

    kind : type of the pixels; clip : what a user knows: a signal of coded pixels, 0..1, or light
    mean : of several pixels
    """
    if kind.kind == "f":
        return clip or float("inf")
    signal = clip or (CLIPPED_8 if kind.itemsize == 1 else CLIPPED_16)
    signal = min(signal, CLIPPED_MEAN) if mean else signal
    if response is not None:
        return float(response[int(255 * signal)].min())
    return float(decode(np.array(signal), transfer))
