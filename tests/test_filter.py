"""Descriptors: what is refused, what converts, and that every description follows from them."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.filter import Filter, Parameter, Percentage, describe, to_json

A_FILTER = Filter(
    "compute_some_thing",
    "Some thing",
    ("mesh", "texels"),
    ("thing",),
    (
        Parameter("steps", "int", 3, minimum=1, maximum=9, unit="rounds", help="How many."),
        Parameter("mode", "enum", "fast", choices=("fast", "good")),
        Parameter("verbose", "bool", True),
        Parameter("randomSeed", "int", 0),
    ),
    help="Does some thing.",
    reference="Somebody 2012",
)

A = Parameter("a", "int", 0)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("bool", "true", True),
        ("bool", "False", False),
        ("bool", "1", True),
        ("bool", np.True_, True),
        ("int", "7", 7),
        ("int", 7.0, 7),
        ("int", np.int32(7), 7),
        ("float", "-1e3", -1000.0),
        ("float", 2, 2.0),
        ("string", "", ""),
        ("layer", "scan, full", "scan, full"),
        ("path", "", None),
        ("path", None, None),
        ("path", "a/b.png", Path("a/b.png")),
        ("length", "2 %", Percentage(2.0)),
        ("length", "2", 2.0),
        ("length", Percentage(3.0), Percentage(3.0)),
    ],
)
def test_values_become_what_apply_receives(kind, value, expected):
    default = {"bool": False, "path": "", "string": "", "layer": ""}.get(kind, 0)
    converted = Parameter("p", kind, default).check(value)
    assert converted == expected
    assert type(converted) is type(expected)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("bool", "maybe"),
        ("bool", 1),
        ("bool", 2.0),
        ("int", 1.5),
        ("int", "x"),
        ("int", True),
        ("int", float("inf")),
        ("float", float("nan")),
        ("float", "nan"),
        ("float", None),
        ("float", False),
        ("string", 3),
        ("layer", None),
        ("path", 3),
        ("length", "x%"),
        ("length", "nan%"),
        ("length", [1]),
        ("points", "1 2"),
        ("points", "1 2 x"),
        ("points", [[1, 2, np.inf]]),
        ("points", np.zeros(3)),
    ],
)
def test_what_is_no_such_value_is_refused_by_name(kind, value):
    default = {"bool": False, "path": "", "string": "", "layer": "", "points": ()}.get(kind, 0)
    with pytest.raises(SvbrdfError, match=r"compute_x: parameter p is .*, expected "):
        Parameter("p", kind, default).check(value, "compute_x")


def test_meshlabs_lengths_are_accepted():
    pymeshlab = pytest.importorskip("pymeshlab")
    parameter = Parameter("near", "length", "1%")
    assert parameter.check(pymeshlab.PercentageValue(50)) == Percentage(50.0)
    assert parameter.check(pymeshlab.PureValue(0.25)) == 0.25
    assert Percentage(50.0).resolve(8.0) == 4.0


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), max_size=5))
def test_points_survive_being_written_as_text(points):
    text = "; ".join(" ".join(map(repr, point)) for point in points)
    read = Parameter("p", "points", ()).check(text)
    assert read.shape == (len(points), 3)
    assert np.array_equal(read, np.array(points).reshape(-1, 3))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("Name", "int", 0), "lower-case"),
        (("a b", "int", 0), "lower-case"),
        (("p", "real", 0), "kind"),
        (("p", "enum", "a"), "choices"),
        (("p", "int", 0, ("a",)), "choices"),
        (("p", "enum", "c", ("a", "b")), "default"),
        (("p", "int", 0, (), 1), "default"),
        (("p", "float", 2.0, (), None, 1.0), "default"),
    ],
)
def test_parameters_that_contradict_themselves_are_refused(arguments, says):
    with pytest.raises(ValueError, match=says):
        Parameter(*arguments)


@pytest.mark.parametrize(
    "change",
    [
        {"name": "Compute"},
        {"needs": ("mesh", "mesh")},
        {"needs": ("texels",), "needs_if": {"texels": ("a", 1)}, "parameters": (A,)},
        {"needs_if": {"Texels": ("a", 1)}, "parameters": (A,)},
        {"writes": ("mesh",)},
        {"writes": ("T",)},
        {"parameters": (Parameter("a", "int", 0), Parameter("a", "bool", True))},
        {"parameters": (Parameter("force", "bool", False),)},
    ],
)
def test_filters_that_contradict_themselves_are_refused(change):
    with pytest.raises(ValueError, match=r"."):
        Filter(**{"name": "f", "title": "F", **change})


@pytest.mark.parametrize("need", [("b", 1), ("a", "many")], ids=["no parameter", "no value of it"])
def test_needs_hang_on_parameters_that_there_are(need):
    with pytest.raises(SvbrdfError, match="f"):
        Filter("f", "F", needs_if={"texels": need}, parameters=(A,))


def test_some_products_are_needed_at_a_parameters_value_only():
    some = Filter("f", "F", ("mesh",), needs_if={"texels": ("a", 1)}, parameters=(A,))
    assert some.needs_with(some.check({})) == ("mesh",)
    assert some.needs_with(some.check({"a": "1"})) == ("mesh", "texels")
    assert "Needs: mesh, texels (if a=1). " in describe(some)
    assert to_json(some)["requirementsIf"] == {"texels": {"a": 1}}


def test_defaults_fill_in_and_unknown_names_are_told_with_what_is_near():
    assert vars(A_FILTER.check({"steps": "5"})) == {
        "steps": 5,
        "mode": "fast",
        "verbose": True,
        "randomSeed": 0,
    }
    with pytest.raises(SvbrdfError, match=r"no parameter stesp, did you mean steps\?"):
        A_FILTER.check({"stesp": 1})
    with pytest.raises(SvbrdfError, match=r"parameter mode is 'best', expected one of fast, good"):
        A_FILTER.check({"mode": "best"})
    with pytest.raises(SvbrdfError, match=r"a whole number from 1 to 9 \(rounds\)"):
        A_FILTER.check({"steps": 10})


def test_descriptions_name_everything_declared():
    text, described = describe(A_FILTER), to_json(A_FILTER)
    assert json.loads(json.dumps(described)) == described
    assert [p["id"] for p in described["parameters"]] == [p.name for p in A_FILTER.parameters]
    for word in ("compute_some_thing", "steps", "rounds", "fast, good", "Somebody 2012", "thing"):
        assert word in text
        assert word in json.dumps(described) or word == "fast, good"
