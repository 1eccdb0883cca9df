"""Finding filters: the pages of `meshlab_svbrdf.filters`, and those that other packages offer.

A third party declares, in its own pyproject.toml,

    [project.entry-points."meshlab_svbrdf.filters"]
    my_filter = "my_package.my_filter"      # a module with FILTER and apply, as ours
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from dataclasses import replace
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType

from .errors import SvbrdfError
from .filter import Filter

GROUP = "meshlab_svbrdf.filters"


def load(module: ModuleType) -> Filter:
    """The filter on one page: its FILTER, joined with its `apply`."""
    for name in ("FILTER", "apply"):
        if not hasattr(module, name):
            raise SvbrdfError(f"{module.__name__} is not a filter: it has no {name}")
    return replace(module.FILTER, apply=module.apply)


@cache
def filters() -> dict[str, Filter]:
    """Every filter by name, ours first."""
    package = importlib.import_module(GROUP)
    names = [page.name for page in pkgutil.iter_modules(package.__path__)]
    modules = [importlib.import_module(f"{GROUP}.{name}") for name in names if name[0] != "_"]
    modules += [point.load() for point in entry_points(group=GROUP)]
    found: dict[str, Filter] = {}
    for module in modules:
        filter = load(module)
        if filter.name in found:
            raise SvbrdfError(f"two filters are named {filter.name}; one is in {module.__name__}")
        found[filter.name] = filter
    return found


def get(name: str) -> Filter:
    """The filter of that name, or an error with the names that come near it."""
    found = filters()
    if name not in found:
        close = difflib.get_close_matches(name, found, 3, 0.4)
        hint = (
            f"did you mean {' or '.join(close)}?" if close else "`meshlab-svbrdf filters` lists all"
        )
        raise SvbrdfError(f"there is no filter {name}: {hint}")
    return found[name]


def writers(product: str) -> list[str]:
    """Names of the filters that make `product`, those that only edit it left out."""
    return [f.name for f in filters().values() if product in f.writes and product not in f.edits]
