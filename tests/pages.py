"""HTML pages, read strictly."""

from html.parser import HTMLParser

ALONE = {"br", "img", "meta", "path", "line", "circle", "rect"}


def parsed(markup: str) -> list[tuple[str, dict[str, str]]]:
    """All elements with their attributes; every one that is opened has to be closed in turn."""
    found: list[tuple[str, dict[str, str]]] = []
    open_: list[str] = []

    class Elements(HTMLParser):
        def handle_starttag(self, name, attributes):
            found.append((name, dict(attributes)))
            open_.append(name)

        def handle_startendtag(self, name, attributes):
            assert name in ALONE, name
            found.append((name, dict(attributes)))

        def handle_endtag(self, name):
            assert open_.pop() == name

    parser = Elements()
    parser.feed(markup)
    parser.close()
    assert not open_
    return found
