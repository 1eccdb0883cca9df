"""The filters' reference, made from their descriptors: docs/filters.md and a part of each page.

    python docs/make_filters.py

On a page the part stands between `<!-- filter: NAME -->` and `<!-- end -->`. tests/test_docs.py
fails where a page is behind its descriptor.
"""

from __future__ import annotations

import re
from pathlib import Path

from meshlab_svbrdf import registry
from meshlab_svbrdf.filter import Filter, describe

HERE = Path(__file__).parent
PART = re.compile(r"<!-- filter: (\w+) -->\n.*?<!-- end -->", re.DOTALL)
HEAD = """# Filters

Made from the descriptors by `python docs/make_filters.py`; the shell shows the same with
`meshlab-svbrdf filters NAME`. Every filter also takes `force` (Python) or `--force` (shell): run
although the result is there already.
"""


def own_filters() -> dict[str, Filter]:
    """The filters of this package, without those that other packages add."""
    return {
        name: found
        for name, found in registry.filters().items()
        if found.apply is not None and found.apply.__module__.startswith("meshlab_svbrdf.filters.")
    }


def reference(pages: dict[str, str]) -> str:
    """The text of filters.md; `pages` tells which page a filter is explained on."""
    parts = [HEAD]
    for name, found in own_filters().items():
        text = describe(found)
        if name in pages:
            text += f"\nExplained in [{pages[name]}]({pages[name]}).\n"
        parts.append(text)
    return "\n".join(parts)


def with_descriptors(page: str) -> str:
    """A page's text with its filters' parts as the descriptors say now."""
    filters = own_filters()

    def part(match: re.Match[str]) -> str:
        text = describe(filters[match[1]]).replace(f"## {match[1]}", f"### `{match[1]}`")
        return f"<!-- filter: {match[1]} -->\n{text}<!-- end -->"

    return PART.sub(part, page)


def current() -> dict[Path, str]:
    """What every page of the documentation should hold."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(HERE.glob("*.md"))}
    pages = {match[1]: path.name for path, text in texts.items() for match in PART.finditer(text)}
    made = {path: with_descriptors(text) for path, text in texts.items()}
    return made | {HERE / "filters.md": reference(pages)}


if __name__ == "__main__":
    for path, text in current().items():
        path.write_text(text, encoding="utf-8")
