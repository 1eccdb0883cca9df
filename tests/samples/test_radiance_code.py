"""Codes of radiance: an exact inverse, an error bound, the kernel and NumPy alike."""

import numpy as np

from meshlab_svbrdf.samples.radiance_code import (
    LARGEST,
    code_of,
    decode_radiance,
    encode_radiance,
    table,
)

CODES = np.arange(1 << 16, dtype=np.uint16)


def test_every_code_comes_back():
    linear = table()
    assert (np.diff(linear) > 0).all()
    assert linear[0] == 0
    assert linear[-1] < 1
    np.testing.assert_array_equal(encode_radiance(linear * np.float32(LARGEST)), CODES)
    np.testing.assert_array_equal([code_of(x) for x in linear[::97]], CODES[::97])


def test_forty_octaves_below_one_and_24_above_are_within_a_2048th():
    rng = np.random.default_rng(0)
    radiance = np.exp2(rng.uniform(-39, 23.99, 100_000)).astype(np.float32)
    codes = encode_radiance(radiance)
    error = np.abs(decode_radiance(codes) / radiance.astype(float) - 1)
    assert error.max() <= 1 / 2048
    kernel = [code_of(x) for x in radiance[:500] * np.float32(1 / LARGEST)]
    np.testing.assert_array_equal(kernel, codes[:500])


def test_extremes_go_to_the_ends():
    assert encode_radiance(np.float32([0, 1e-30, LARGEST, 1e30])).tolist() == [0, 0, 65535, 65535]
