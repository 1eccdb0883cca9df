"""Ways to damage a file, seeded: bytes, numbers and words that no honest writer would write."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"-1e-320", b"1.5", b"2147483648",
    b"4294967296", b"99999999999999999999", b"9" * 5000, b"", b"NaN", b"Infinity", b"1,5", b"0x10",
)  # fmt: skip
WORD = re.compile(rb"[A-Za-z_]{3,}")
WORDS = (
    b"", b"../../../outside", b"/etc/passwd", b"\xff\xfe", "ä€𝄞 ".encode(), b"a" * 10_000, b"null",
    b"true", b"[]", b"{}", b"%s%n", b"\0", b"'\"<>&", b"list", b"double",
)  # fmt: skip
PUNCTUATION = re.compile(rb"[][{}<>\"',:=/]")


def damaged(data: bytes, seed: int, text: bool) -> Iterator[bytes]:
    """Endless damaged copies of `data`; text : whether numbers and words are damaged too"""
    rng = np.random.default_rng(seed)
    ways = [_flipped, _cut, _removed, _repeated, _ends, _noise]
    if text:
        ways += [_number, _word, _punctuation] * 3
    while True:
        copy = data
        for _ in range(int(rng.geometric(0.6))):
            copy = ways[rng.integers(len(ways))](copy, rng)
        yield copy


def _span(data: bytes, rng: np.random.Generator) -> tuple[int, int]:
    first = int(rng.integers(len(data) + 1))
    return first, min(len(data), first + int(rng.geometric(0.05)))


def _flipped(data: bytes, rng: np.random.Generator) -> bytes:
    if not data:
        return data
    copy = bytearray(data)
    copy[rng.integers(len(copy))] ^= 1 << int(rng.integers(8))
    return bytes(copy)


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _removed(data: bytes, rng: np.random.Generator) -> bytes:
    first, stop = _span(data, rng)
    return data[:first] + data[stop:]


def _repeated(data: bytes, rng: np.random.Generator) -> bytes:
    first, stop = _span(data, rng)
    return data[:stop] + data[first:stop] * int(rng.integers(1, 50)) + data[stop:]


def _ends(data: bytes, rng: np.random.Generator) -> bytes:
    """Four or eight bytes that, as a count, are gigantic or negative."""
    first = int(rng.integers(len(data) + 1))
    size = int(rng.choice([4, 8]))
    value = [b"\xff" * size, b"\x7f" + b"\xff" * (size - 1), b"\xff" * (size - 1) + b"\x7f"]
    return data[:first] + value[rng.integers(3)] + data[first + size :]


def _noise(data: bytes, rng: np.random.Generator) -> bytes:
    first, stop = _span(data, rng)
    return data[:first] + rng.bytes(stop - first) + data[stop:]


def _replaced(pattern: re.Pattern[bytes], others: tuple[bytes, ...]):
    def replace(data: bytes, rng: np.random.Generator) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        match = found[rng.integers(len(found))]
        return data[: match.start()] + others[rng.integers(len(others))] + data[match.end() :]

    return replace


_number = _replaced(NUMBER, NUMBERS)
_word = _replaced(WORD, WORDS)
_punctuation = _replaced(PUNCTUATION, (b"", b"[", b"]", b"<", b">", b'"', b",", b"{", b"}"))
