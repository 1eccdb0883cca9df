"""What is true of every filter: needs are named, bad parameters refused, nothing is half done."""

import json

import numpy as np
import pytest
from totems import CHAIN, DIFFUSE, SAMPLES, TEXELS, WALK, contents, copied, film, run, sized

from meshlab_svbrdf import registry
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import MissingStageError, SvbrdfError
from meshlab_svbrdf.filter import INPUTS

FILTERS = registry.filters()
OURS = [name for name, f in FILTERS.items() if f.apply.__module__.startswith("meshlab_svbrdf.")]
NEEDS = [(name, need, {}) for name in OURS for need in FILTERS[name].needs if need not in INPUTS]
NEEDS += [
    (name, need, {parameter: value})
    for name in OURS
    for need, (parameter, value) in FILTERS[name].needs_if.items()
]


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, WALK, tmp_path)


def test_the_chain_runs_filters_after_those_that_they_need():
    made = set(INPUTS)
    for name in CHAIN:
        assert {*FILTERS[name].needs, *FILTERS[name].needs_if} <= made
        made |= set(FILTERS[name].writes)
    assert all(len(registry.writers(need)) == 1 for _, need, _ in NEEDS)


@pytest.mark.parametrize(("name", "need", "given"), NEEDS)
def test_a_missing_stage_is_named(result, name, need, given):
    for other in {*FILTERS[name].needs} - {*INPUTS}:
        if not result.has(other):  # the chain does not make it
            result.apply(*registry.writers(other))
    before = result.results.record
    products = {k: v for k, v in before["products"].items() if k != need}
    record = json.dumps(before | {"products": products})
    path = result.folder / "svbrdf.json"
    path.unlink()  # it is shared with the original
    path.write_text(record)
    (writer,) = registry.writers(need)
    needed = need.replace("_", " ")
    with pytest.raises(MissingStageError, match=f"{name} needs the {needed}: run {writer} first"):
        result.apply(name, **given)


@pytest.mark.parametrize("name", OURS)
def test_bad_parameters_are_refused_before_anything_happens(result, name):
    before = contents(result.folder)
    bad = [("no_such_parameter", 1)]
    for parameter in FILTERS[name].parameters:
        if parameter.minimum is not None:
            bad.append((parameter.name, parameter.minimum - 1))
        if parameter.maximum is not None:
            bad.append((parameter.name, parameter.maximum + 1))
        if parameter.kind in ("int", "float"):
            bad += [(parameter.name, "many"), (parameter.name, np.nan)]
        if parameter.kind in ("enum", "bool", "points"):
            bad.append((parameter.name, "neither"))
    for parameter, value in bad:
        with pytest.raises(SvbrdfError, match=rf"{name}.* parameter {parameter}\b"):
            result.apply(name, **{parameter: value})
    assert contents(result.folder) == before


@pytest.mark.parametrize("name", CHAIN)
def test_a_filter_that_breaks_leaves_the_former_result(result, name, monkeypatch):
    """It breaks at its last step, when it has set nearly everything."""
    filter = registry.get(name)
    before = contents(result.folder)

    def breaks(document, parameters, progress):
        filter.apply(document, parameters, progress)
        document.set_json("half_done", {})
        raise RuntimeError("the power went out")

    monkeypatch.setitem(registry.filters(), name, type(filter)(**{**vars(filter), "apply": breaks}))
    given = {"texture_size": 64} if name == TEXELS else {"step": 2} if name == SAMPLES else {}
    with pytest.raises(RuntimeError, match="the power went out"):
        result.apply(name, force=True, **given)
    assert contents(result.folder) == before
    monkeypatch.undo()
    given = sized(WALK).get(name, {})
    assert result.apply(name, **given).skipped


def test_earlier_results_are_kept_where_a_later_filter_fails(tmp_path_factory, tmp_path):
    project = film(tmp_path_factory, WALK)
    with pytest.raises(SvbrdfError, match="parameter cone"):
        run(Document.open(project, tmp_path), DIFFUSE, **sized(WALK, **{DIFFUSE: {"cone": -1}}))
    outcomes = run(Document.open(project, tmp_path), DIFFUSE, **sized(WALK))
    assert [outcome.skipped for outcome in outcomes.values()] == [True] * 5 + [False]
