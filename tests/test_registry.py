"""Finding filters: the installed pages, third parties, and wrong names."""

import types
from importlib.resources import files

import pytest

from meshlab_svbrdf import commands, commands_show, registry
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import INPUTS, Filter
from meshlab_svbrdf.script import check_script, read_script


def test_every_page_is_a_filter_named_as_its_file():
    pages = {
        p.name.removesuffix(".py")
        for p in files(registry.GROUP).iterdir()
        if p.name.endswith(".py")
    }
    found = registry.filters()
    assert {page for page in pages if page[0] != "_"} <= set(found)
    for name, filter in found.items():
        assert filter.name == name
        assert filter.apply is not None
        assert filter.title
        assert filter.help


def test_everything_needed_is_written_by_some_filter():
    found = registry.filters().values()
    written = {product for filter in found for product in filter.writes} | set(INPUTS)
    needed = {need for filter in found for need in (*filter.needs, *filter.needs_if)}
    assert needed <= written


@pytest.mark.parametrize("chain", ["svbrdf.mlx", "svbrdf_paper.mlx"])
def test_the_chains_run_what_each_filter_needs_before_it(chain):
    steps = read_script(str(files(registry.GROUP) / chain))
    check_script(steps)
    made = set(INPUTS)
    for step in steps:
        filter = registry.get(step.name)
        assert set(filter.needs_with(filter.check(step.parameters))) <= made, step.name
        made |= set(filter.writes)


def test_what_the_shell_sets_exists():
    wanted = (
        commands.TEXTURE_SIZE.split("."),
        commands.MATERIALS.split("."),
        (commands_show.RENDERING, "cameras"),
        (commands_show.RENDERING, "folder"),
    )
    for name, parameter in wanted:
        assert parameter in [p.name for p in registry.get(name).parameters]


def test_a_wrong_name_is_told_with_what_is_near(demos):
    with pytest.raises(SvbrdfError, match=r"no filter compute_demo_texel.*compute_demo_texels"):
        registry.get("compute_demo_texel")
    with pytest.raises(SvbrdfError, match="meshlab-svbrdf filters"):
        registry.get("qqqq")
    assert registry.writers("shade") == ["compute_demo_shade"]


def third_party(name: str) -> types.ModuleType:
    module = types.ModuleType("their_package.their_filter")
    module.FILTER = Filter(name, "Theirs")
    module.apply = lambda document, parameters, progress: "theirs"
    return module


@pytest.fixture
def entry_point(monkeypatch):
    """Offers a module under the entry point group, as an installed package would."""
    offered = []
    point = types.SimpleNamespace(load=lambda: offered[0])
    monkeypatch.setattr(
        registry, "entry_points", lambda group: [point] if group == registry.GROUP else []
    )
    yield offered.append
    registry.filters.cache_clear()


def test_third_parties_filters_are_found(entry_point):
    entry_point(third_party("compute_their_thing"))
    registry.filters.cache_clear()
    assert registry.get("compute_their_thing").apply(None, None, None) == "theirs"


def test_two_filters_of_one_name_are_refused(entry_point):
    entry_point(third_party("compute_svbrdf_texels"))
    registry.filters.cache_clear()
    with pytest.raises(SvbrdfError, match="two filters are named compute_svbrdf_texels"):
        registry.filters()


def test_a_module_without_apply_is_no_filter():
    module = third_party("compute_their_thing")
    del module.apply
    with pytest.raises(SvbrdfError, match="their_filter is not a filter: it has no apply"):
        registry.load(module)
