"""Transfer functions: exact inverses, levels that are known, codes of both widths."""

import warnings

import numpy as np
import pytest

from meshlab_svbrdf.samples import transfer
from meshlab_svbrdf.samples.transfer import LOGS, TRANSFERS, clip_level, decode, encode, light_of

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import colour


@pytest.mark.parametrize("name", TRANSFERS)
def test_decoding_is_the_inverse_of_encoding(name):
    signal = np.linspace(0, 1, 4097)
    light = decode(signal, name)
    assert np.isfinite(light).all()
    assert (light >= 0).all()
    seen = light > 0  # below its black a curve holds noise only
    # Rec. 709, D-Log and N-Log are published with coefficients that do not quite meet
    tolerance = {"rec709": 3e-4, "dlog": 2e-6, "nlog": 2e-4}.get(name, 1e-9)
    np.testing.assert_allclose(encode(light, name)[seen], signal[seen], atol=tolerance)
    assert (np.diff(light[seen]) > 0).mean() > 0.999


def test_logs_are_those_of_colour_science():
    assert set(LOGS.values()) <= set(colour.LOG_DECODINGS)
    assert len(set(LOGS.values())) == len(LOGS)


@pytest.mark.parametrize("name", ["slog3", "arrilogc3", "vlog", "rec709", "srgb"])
def test_white_is_one(name):
    assert decode(encode(np.array([0.18, 1.0]), name), name) == pytest.approx([0.18, 1.0])


def test_reference_white_of_hdr_is_one():
    assert decode(np.array(0.75), "hlg") == pytest.approx(1)
    assert decode(encode(np.array(1.0), "pq"), "pq") == pytest.approx(1)
    assert encode(np.array(1.0), "pq") == pytest.approx(0.58, abs=0.002)  # BT.2408


def test_gamuts_are_colour_sciences():
    expected = colour.matrix_RGB_to_RGB("ITU-R BT.2020", "sRGB", None)
    np.testing.assert_allclose(transfer.REC2020_TO_REC709, expected, atol=5e-4)
    grey = light_of(np.full((1, 1, 3), 0.5, np.float32), "linear", wide_gamut=True)
    np.testing.assert_allclose(grey, 0.5, rtol=1e-5)


def test_pixels_of_both_widths_say_the_same():
    codes = np.arange(256, dtype=np.uint8).repeat(3).reshape(1, -1, 3)
    for name in ("srgb", "rec709", "slog3"):
        wide = light_of(codes.astype(np.uint16) * 257, name)
        np.testing.assert_array_equal(light_of(codes, name), wide)
    np.testing.assert_array_equal(light_of(np.float32([[[7.5, 0, 1]]]), "srgb")[0, 0], [7.5, 0, 1])


def test_floats_are_not_clipped_unless_told():
    assert clip_level(np.dtype(np.float32), "linear") == np.inf
    assert clip_level(np.dtype(np.float32), "linear", clip=1.0) == 1
    assert clip_level(np.dtype(np.uint16), "linear") == pytest.approx(65470 / 65535)
    assert clip_level(np.dtype(np.uint8), "srgb") == decode(np.array(254 / 255), "srgb")
    assert clip_level(np.dtype(np.uint8), "srgb", mean=True) == decode(np.array(250 / 255), "srgb")
