"""Filter scripts: read, refused before anything runs, run with MeshLab's filters between ours."""

import numpy as np
import pytest

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import DocumentError, SvbrdfError
from meshlab_svbrdf.script import Step, check_script, read_script, run_script, write_script

pytestmark = pytest.mark.usefixtures("demos")

TEXELS = '<filter name="compute_demo_texels"><Param name="size" type="RichInt" value="8"/></filter>'
SHADE = '<filter name="compute_demo_shade"/>'
SUBDIVIDE = (
    '<filter name="Subdivision Surfaces: Midpoint">'
    '<Param name="Iterations" type="RichInt" value="1"/>'
    '<Param name="Threshold" type="RichAbsPerc" value="0" min="0" max="1"/></filter>'
)


@pytest.fixture
def script(tmp_path):
    def write(body: str, start: str = "<!DOCTYPE FilterScript>"):
        path = tmp_path / "chain.mlx"
        path.write_text(f"{start}<FilterScript>{body}</FilterScript>", encoding="utf-8")
        return path

    return write


@pytest.fixture
def document(small_project, tmp_path):
    return Document.open(small_project, tmp_path / "out")


def test_steps_are_read_in_order_with_their_parameters(script):
    steps = read_script(script(TEXELS + SUBDIVIDE + SHADE))
    assert [step.ours for step in steps] == [True, False, True]
    assert steps[0].parameters == {"size": "8"}
    assert steps[1].parameters == {"Iterations": "1", "Threshold": "0"}
    assert steps[1].where.endswith("chain.mlx, filter 2")


def test_writing_is_the_inverse_of_reading(script, tmp_path):
    steps = read_script(script(TEXELS + SUBDIVIDE))
    steps.append(Step("compute_demo_shade", {"scale": "2.5", "stroke": "1 2 3; 4 5 6"}))
    write_script(tmp_path / "again.mlx", steps)
    again = read_script(tmp_path / "again.mlx")
    assert [(s.name, s.parameters) for s in again] == [(s.name, s.parameters) for s in steps]
    assert 'type="RichInt"' in (tmp_path / "again.mlx").read_text()


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("<filter/>", "filter 1: expected <filter"),
        (SHADE + "<mesh name='x'/>", "filter 2: expected <filter"),
        (
            TEXELS.replace("/></filter>", "/><Param name='size' value='9'/></filter>"),
            "'size' twice",
        ),
        (TEXELS.replace('name="size"', ""), "without a name"),
    ],
)
def test_what_is_no_script_is_refused_with_its_place(script, body, says):
    with pytest.raises(SvbrdfError, match=says):
        read_script(script(body))


def test_other_xml_and_no_xml_are_refused(tmp_path):
    path = tmp_path / "x.mlx"
    with pytest.raises(DocumentError, match=r"x\.mlx: cannot be read"):
        read_script(path)
    path.write_text("<MeshLabProject/>")
    with pytest.raises(SvbrdfError, match="expected <FilterScript>, found <MeshLabProject>"):
        read_script(path)
    path.write_text("<FilterScript>" + "<a>" * 99_999)
    with pytest.raises(DocumentError, match=r"x\.mlx, line 1: <a> lies in 100 other elements"):
        read_script(path)
    path.write_text("<FilterScript>")
    with pytest.raises(DocumentError, match="not well-formed"):
        read_script(path)


def test_entities_are_refused(script):
    bomb = '<!DOCTYPE FilterScript [<!ENTITY a "aaa"><!ENTITY b SYSTEM "file:///etc/passwd">]>'
    with pytest.raises(DocumentError, match="XML entity 'a'"):
        read_script(script("&a;", bomb))


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (TEXELS.replace("texels", "texel"), r"filter 2: .*'compute_demo_texel', did you mean"),
        (TEXELS.replace('"size"', '"sise"'), r"filter 2: .* no parameter sise, did you mean size"),
        (TEXELS.replace('"8"', '"80"'), r"filter 2: .*size is '80', expected .* 4 to 64"),
        ('<filter name="Nobody Knows This"/>', "filter 2: neither this suite nor MeshLab"),
        (SUBDIVIDE.replace("Iterations", "Bogus"), "filter 2: Subdivision.* no parameter Bogus"),
    ],
)
def test_nothing_runs_where_any_step_is_wrong(script, document, bad, says):
    with pytest.raises(SvbrdfError, match=says):
        list(run_script(document, read_script(script(TEXELS + bad + SHADE))))
    assert not document.folder.exists()


@pytest.mark.parametrize(
    "name", ["Alpha Wrap", "Re-Orient all faces coherently", "Compute Scalar by Heat Geodesic"]
)
def test_filters_that_pymeshlab_lists_under_no_old_name_are_known_by_their_text(name):
    known = name != "Compute Scalar by Heat Geodesic"
    if known:
        check_script([Step(name)])
    else:
        with pytest.raises(SvbrdfError, match="neither"):
            check_script([Step(name)])


def test_meshlabs_filters_work_between_ours(script, document, stone):
    steps = read_script(script(TEXELS + SUBDIVIDE + TEXELS + SHADE))
    matrix = document.object_layer().matrix
    outcomes = list(run_script(document, steps))
    assert [outcome.skipped for outcome in outcomes] == [False, False, False, False]
    assert outcomes[1].message == "done by MeshLab"
    assert len(document.mesh().faces) == 4 * len(stone.faces)
    assert np.array_equal(document.object_layer().matrix, matrix)
    again = Document.open(document.save())
    assert len(again.mesh().faces) == 4 * len(stone.faces)
    assert [o.skipped for o in run_script(again, read_script(script(TEXELS + SHADE)))] == [
        True,
        True,
    ]


def test_a_filter_of_meshlabs_that_fails_is_named(script, document):
    body = '<filter name="Select Faces with edges longer than..."/>'
    failing = '<filter name="Transfer Vertex Attributes to Texture (1 or 2 meshes)"/>'
    with pytest.raises(SvbrdfError, match=r"MeshLab's filter|neither"):
        list(run_script(document, read_script(script(failing + body))))
    assert len(document.layers) == 1


def test_an_unchanged_chain_does_not_run_and_a_forced_one_does(script, document):
    steps = read_script(script(TEXELS + SHADE))
    for force, skipped in ((False, False), (False, True), (True, False)):
        outcomes = list(run_script(document, steps, force=force))
        assert [outcome.skipped for outcome in outcomes] == [skipped, skipped]


def test_a_script_that_edits_what_it_makes_gives_the_same_again(script, document):
    """What follows an edit does not run twice; an edit of the user's between runs is kept."""
    edit, after = '<filter name="apply_demo_edit"/>', TEXELS + SHADE
    steps = read_script(script(after + edit))
    list(run_script(document, steps))
    once = document.attribute("height")
    assert [o.skipped for o in run_script(document, steps)] == [True, False, False]
    np.testing.assert_array_equal(document.attribute("height"), once)
    assert [o.skipped for o in run_script(document, read_script(script(after)))] == [True, True]
    np.testing.assert_array_equal(document.attribute("height"), once)


def test_progress_is_shown_by_filter(script, document):
    shown = []
    steps = read_script(script(TEXELS + SHADE))
    list(
        run_script(
            document, steps, show=lambda name: lambda done, word: shown.append((name, done, word))
        )
    )
    assert shown == [("compute_demo_shade", k / 4, "shading") for k in range(1, 5)]
