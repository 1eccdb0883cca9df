"""Pages: what others wrote is text in them, whatever it is, and nothing comes from elsewhere."""

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pages import parsed

from meshlab_svbrdf.reporting.html import (
    Html,
    escape,
    figure,
    join,
    note,
    page,
    picture,
    section,
    table,
    tag,
)


def text_of(markup: str) -> str:
    found: list[str] = []

    class Text(HTMLParser):
        def handle_data(self, data):
            found.append(data)

        def handle_starttag(self, name, attributes):
            found.extend(value for _, value in attributes)

    parser = Text(convert_charrefs=True)
    parser.feed(markup)
    parser.close()
    return "".join(found)


@given(st.text(st.characters(exclude_categories=("Cc", "Cs"))))
def test_any_text_comes_back_as_it_was(text):
    assert text_of(tag("p", text)) == text
    assert text_of(tag("i", title=text)) == text


@pytest.mark.parametrize(
    "hostile",
    ["<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "</style></title>", "a\0b"],
)
def test_what_looks_like_markup_is_text_wherever_it_stands(hostile):
    image = np.zeros((2, 2, 3), np.uint8)
    parts = [
        section(hostile, note(hostile), hostile), table([hostile], [[hostile]], 0),
        picture(image, hostile), figure(tag("svg"), hostile), tag("p", hostile, class_=hostile),
    ]  # fmt: skip
    made = page(hostile, parts)
    names = {name for name, _ in parsed(made)}
    assert "script" not in names
    assert not any(key.startswith("on") for _, given in parsed(made) for key in given)
    assert len([n for n, _ in parsed(made) if n == "img"]) == 1
    assert "\0" not in made


def test_what_was_made_here_is_not_escaped_twice():
    inner = tag("b", "a & b")
    assert tag("p", inner) == "<p><b>a &amp; b</b></p>"
    assert escape(inner) is inner
    assert join([inner, "<"]) == "<b>a &amp; b</b>&lt;"
    assert isinstance(join([]), Html)


def test_a_picture_is_in_the_page_and_small():
    rng = np.random.default_rng(0)
    image = cv2.resize(rng.integers(0, 256, (9, 16, 3), np.uint8), (1600, 900))
    made = picture(image, "a view", 400)
    (source,) = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', made)
    data = np.frombuffer(base64.b64decode(source), np.uint8)
    back = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]
    assert back.shape == (225, 400, 3)
    small = cv2.resize(image, (400, 225), interpolation=cv2.INTER_AREA)
    assert np.abs(back.astype(int) - small).mean() < 4
    assert 'width="400" height="225"' in made


def test_a_page_is_whole_and_forbids_what_is_elsewhere():
    made = page("t", [tag("p", "x")])
    assert made.startswith("<!DOCTYPE html>")
    assert "default-src &#x27;none&#x27;" in made
    assert "://" not in made
