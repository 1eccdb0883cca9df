"""A session without its page: edits, undo, what is saved, and what is refused."""

import threading
from pathlib import Path

import numpy as np
import pytest
from totems import (
    DIFFUSE,
    ENVIRONMENT,
    GLOSS,
    MATERIALS,
    SAMPLES,
    THRESHOLD,
    WALK,
    contents,
    copied,
    film,
    run,
    sized,
)

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import MissingStageError, SvbrdfError
from meshlab_svbrdf.filters._materials import read_edits, read_names
from meshlab_svbrdf.reflectance.density import highest_bell
from meshlab_svbrdf.script import read_script, run_script
from meshlab_svbrdf.viewing import maps, picking
from meshlab_svbrdf.viewing.command import serve
from meshlab_svbrdf.viewing.scene import Scene
from meshlab_svbrdf.viewing.session import ConflictError, Session


@pytest.fixture
def project(tmp_path_factory, tmp_path) -> Path:
    return copied(tmp_path_factory, WALK, tmp_path / "result").save()


@pytest.fixture
def session(project) -> Session:
    return Session(Scene(project))


def saved(project: Path) -> np.ndarray:
    return Document.open(project).attribute("material").astype(int)


def loop(session: Session, height: float, points: int = 48) -> np.ndarray:
    """A ring of points of the world around the object, where rays from outside meet it."""
    turn = np.linspace(0, 2 * np.pi, points + 1)
    out = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], 1)
    center, radius = session.scene.texels.center, session.scene.texels.radius
    start = center + [0, height, 0] + 3 * radius * out
    return picking.hits(session, start, -out)


def deepest(session: Session, cluster: int) -> int:
    """A texel in the middle of a cluster."""
    own = np.flatnonzero(session.labels == cluster)
    place = session.scene.texels.position[own]
    return int(own[np.linalg.norm(place - np.median(place, axis=0), axis=1).argmin()])


def test_every_edit_can_be_undone_and_done_again(session):
    states = [session.labels.copy()]
    session.merge([0, 2])
    states.append(session.labels.copy())
    biggest = int(np.bincount(session.labels[session.labels >= 0]).argmax())
    session.rename(biggest, "  glaze   or so ")
    states.append(session.labels.copy())
    session.find(6.0)
    states.append(session.labels.copy())
    assert not (states[1] == 2).any()
    np.testing.assert_array_equal(states[1], np.where(states[0] == 2, 0, states[0]))
    for _ in range(2):
        for before in states[-2::-1]:
            session.undo()
            np.testing.assert_array_equal(session.labels, before)
        with pytest.raises(SvbrdfError, match="nothing to undo"):
            session.undo()
        for after in states[1:]:
            session.redo()
            np.testing.assert_array_equal(session.labels, after)
        with pytest.raises(SvbrdfError, match="nothing to redo"):
            session.redo()
    session.undo()
    assert session.state.names == {biggest: "glaze or so"}
    session.undo()
    session.merge([0, 1])
    with pytest.raises(SvbrdfError, match="nothing to redo"):
        session.redo()


def test_what_is_saved_is_what_was_seen_and_a_script_makes_it_again(session, project, tmp_path):
    session.scene.graph.prepare()
    session.merge([0, 2])
    session.split(loop(session, -0.05))
    new = int(session.labels.max())
    session.rename(new, "upper half")
    assert "saved" in session.save()
    assert not session.dirty
    np.testing.assert_array_equal(saved(project), session.labels)
    document = Document.open(project)
    assert read_names(document) == {new: "upper half"}
    assert len(read_edits(document)) == 2
    assert not document.stale("materials")
    assert document.stale("material_specular") == "materials"

    # The script in the folder, and the page's, on a project that has the automatic materials only
    session.write_script(tmp_path / "by_hand.mlx")
    scripts = (document.folder / "material_edits.mlx", tmp_path / "by_hand.mlx")
    for steps in [read_script(script) for script in scripts]:
        document.apply(MATERIALS, force=True)
        assert read_edits(document) == []
        outcomes = list(run_script(document, steps))
        np.testing.assert_array_equal(document.attribute("material"), session.labels)
        assert not any(outcome.skipped for outcome in outcomes[1:])
    assert read_names(document) == {new: "upper half"}

    # The next filter takes them
    assert not document.apply(GLOSS).skipped
    there = {entry["id"] for entry in document.json("materials")["materials"]}
    assert there == set(np.unique(session.labels).tolist()) - {-1}


def test_a_later_session_goes_on_and_undo_reaches_past_what_was_saved(session, project):
    opened = session.labels.copy()
    session.merge([0, 1])
    session.save()
    later = Session(Scene(project))
    np.testing.assert_array_equal(later.labels, session.labels)
    later.merge([0, 2])
    later.save()
    np.testing.assert_array_equal(saved(project), later.labels)
    assert len(read_edits(Document.open(project))) == 2
    later.undo()
    later.save()
    np.testing.assert_array_equal(saved(project), session.labels)
    assert len(read_edits(Document.open(project))) == 1
    later.find(5.0)
    later.save()
    np.testing.assert_array_equal(saved(project), later.labels)
    assert read_edits(Document.open(project)) == []
    later.undo()
    later.save()
    np.testing.assert_array_equal(saved(project), session.labels)
    assert not np.array_equal(opened, session.labels)


def test_two_pages_on_one_session_tell_each_other(session):
    behind = session.revision
    session.merge([0, 1], behind)
    before = session.labels.copy()
    with pytest.raises(ConflictError, match="another page changed"):
        session.merge([0, 2], behind)
    with pytest.raises(ConflictError, match="another page changed"):
        session.split(np.zeros((3, 3)), 0, behind)
    with pytest.raises(ConflictError, match="another page changed"):
        session.undo(behind)
    np.testing.assert_array_equal(session.labels, before)


def test_two_sessions_on_one_project_do_not_overwrite_each_other(session, project, tmp_path):
    other = Session(Scene(project))
    other.merge([0, 1])
    other.save()
    session.merge([0, 2])
    before = contents(session.scene.document.folder)
    with pytest.raises(ConflictError, match="nothing was saved"):
        session.save()
    assert contents(session.scene.document.folder) == before
    assert session.dirty
    session.write_script(tmp_path / "kept.mlx")
    assert [step.parameters for step in read_script(tmp_path / "kept.mlx")][-1] == {"ids": "0 2"}


def test_while_another_run_holds_the_project_nothing_is_lost(session, project):
    session.merge([0, 1])
    with Document.open(project).results.locked(), pytest.raises(SvbrdfError, match="another run"):
        session.save()
    assert session.dirty
    session.save()
    np.testing.assert_array_equal(saved(project), session.labels)


def test_strokes_that_mean_nothing_change_nothing(session):
    before, revision = session.labels.copy(), session.revision
    for stroke, cluster, says in (
        (np.zeros((0, 3)), -1, "the stroke misses the object"),
        (session.scene.place(deepest(session, 0))[None], -1, "the stroke misses the object"),
        (np.repeat(session.scene.place(deepest(session, 0))[None], 3, 0), 0, "does not divide"),
        (loop(session, 0.0), 77, "there is no material 77"),
    ):
        with pytest.raises(SvbrdfError, match=says):
            session.split(stroke, cluster)
    unobserved = session.scene.place(int(np.flatnonzero(session.labels < 0)[0]))
    with pytest.raises(SvbrdfError, match="unobserved"):
        session.split(np.repeat(unobserved[None], 3, 0))
    for name, says in (("a" * 61, "at most 60"), ("a;b", "no ;"), ("x", "no material 99")):
        with pytest.raises(SvbrdfError, match=says):
            session.rename(99 if name == "x" else 0, name)
    assert session.revision == revision
    np.testing.assert_array_equal(session.labels, before)


def test_a_pick_tells_the_texel_and_off_the_object_says_so(session):
    scene = session.scene
    rng = np.random.default_rng(3)
    for texel in rng.choice(np.flatnonzero(session.labels >= 0), 40):
        point, normal = scene.place(texel), scene.texels.normal[texel]
        told = picking.pick(session, point + 0.01 * scene.texels.radius * normal, -normal)
        away = np.linalg.norm(scene.place(told["texel"]) - point)
        assert away < 2 * scene.graph.unit
        assert told["cluster"] == session.labels[told["texel"]]
        assert told["samples"] == scene.attribute("samples")[told["texel"]]
    far = scene.texels.center + 5 * scene.texels.radius
    with pytest.raises(SvbrdfError, match="no object under the pointer"):
        picking.pick(session, far, [1.0, 0, 0])
    with pytest.raises(SvbrdfError, match="finite"):
        picking.pick(session, far, [np.nan, 0, 0])


def test_plots_are_those_of_the_filters(session):
    """The peak of a texel, and the bell of a material, as the paper's filters have them."""
    scene = session.scene
    alpha = scene.attribute("alpha")
    texel = int(np.flatnonzero(np.isfinite(alpha) & (session.labels >= 0))[100])
    plot = picking.plot_history(session, texel)
    assert len(plot["luminance"]) == scene.attribute("frames")[texel]
    telling = [peak for peak in plot["peaks"] if peak["alpha"] is not None]
    best = min(telling, key=lambda peak: peak["distance"])
    assert best["alpha"] == pytest.approx(alpha[texel], rel=1e-5)
    assert best["rho_s"] == pytest.approx(scene.attribute("rho_s")[texel], rel=1e-5)
    assert best["light"] == scene.attribute("light")[texel]
    assert plot["luminance"][best["c_max"]] > plot["luminance"][best["c_min"]] > plot["diffuse"]

    # The bell of all its texels' ρs, and one of some texels, computed for want of the filter's
    cluster = int(np.bincount(session.labels[np.isfinite(alpha) & (session.labels >= 0)]).argmax())
    own = session.labels == cluster
    bell = highest_bell(scene.attribute("rho_s")[own], alpha[own])
    told = picking.plot_density(session, cluster)["bell"]
    assert told["rho_s"] == pytest.approx(bell.rho_s, rel=1e-5)
    assert told["low"] < told["rho_s"] < told["high"]
    for name in ("rho_s", "alpha"):
        del scene._attributes[name]
    some = picking.plot_density(session, cluster)["bell"]
    assert some["alpha"] == pytest.approx(told["alpha"], rel=0.05)


def test_maps_have_a_colour_for_every_texel(session):
    names = {entry["name"] for entry in maps.available(session.scene)}
    assert {"diffuse", "materials", "rho_s", "alpha", "threshold", "samples", "frame"} <= names
    for name in names - {"materials"}:
        shown = maps.paint(session.scene, name)
        assert shown.colors.shape == (len(session.labels), 3)
        assert shown.colors.dtype == np.uint8
    seen = session.scene.observations.store
    counts = sum(
        (maps.project_frame(session.scene, f) != maps.UNOBSERVED).any(1).sum()
        for f in range(seen.frames)
    )
    assert counts == pytest.approx(len(seen), rel=1e-3)  # a sample may have the colour of none
    with pytest.raises(SvbrdfError, match="no map 'nothing'"):
        maps.paint(session.scene, "nothing")
    with pytest.raises(SvbrdfError, match="not 99"):
        maps.paint(session.scene, "frame", 99)


def test_a_preview_is_about_what_is_found(session):
    revision = session.revision
    preview = session.preview(7.0)
    assert session.revision == revision
    session.find(7.0)
    assert np.mean(preview == session.labels) > 0.9


def test_a_project_by_gloss_is_found_anew_by_gloss(project):
    document = Document.open(project)
    message = document.apply(MATERIALS, gloss=True).message
    assert "by colour" in message
    session = Session(Scene(project))
    assert session.by_gloss
    session.find(10.0)
    np.testing.assert_array_equal(session.labels, document.attribute("material"))
    session.find(9.0)
    session.save()
    np.testing.assert_array_equal(saved(project), session.labels)

    # Without samples that are up to date it is by colour, and says so
    document = Document.open(project)
    document.apply(SAMPLES, step=2)
    for name in (THRESHOLD, ENVIRONMENT, DIFFUSE):
        document.apply(name)
    later = Session(Scene(project))
    assert not later.by_gloss
    later.find(10.0)
    assert later.state.words == "found with threshold 10, by colour alone"
    assert later.state.start[0].parameters["gloss"] == "false"


def test_projects_without_materials_can_be_given_some_and_say_what_they_lack(
    tmp_path_factory, tmp_path
):
    source = film(tmp_path_factory, WALK)
    with pytest.raises(MissingStageError, match="no texels to show"):
        Scene(source)
    document = Document.open(source, tmp_path / "early")
    run(document, DIFFUSE, **sized(WALK))
    document.save()
    session = Session(Scene(document.path))
    assert session.clusters() == []
    with pytest.raises(SvbrdfError, match="no material 0"):
        session.merge([0, 1])
    session.find(10.0)
    found = session.labels.copy()
    session.save()
    np.testing.assert_array_equal(saved(document.path), found)
    session.undo()
    with pytest.raises(SvbrdfError, match="no materials in this state"):
        session.save()
    np.testing.assert_array_equal(saved(document.path), found)


def test_materials_that_are_out_of_date_are_found_anew(project):
    Document.open(project).apply(DIFFUSE, method="quantile")
    session = Session(Scene(project))
    assert session.clusters() == []
    session.find(10.0)
    session.save()
    assert not Document.open(project).stale("materials")
    np.testing.assert_array_equal(saved(project), session.labels)


def test_what_is_not_saved_when_the_page_ends_is_kept_as_a_script(project):
    lines: list[str] = []

    def edit_and_end(page):
        page.session.merge([0, 1])
        threading.Timer(0.1, page.shutdown).start()

    serve(project, 0, False, lines.append, edit_and_end)
    assert "127.0.0.1" in lines[0]
    assert "totem.unsaved.mlx" in lines[-1]
    steps = read_script(project.with_name("totem.unsaved.mlx"))
    assert steps[-1].parameters == {"ids": "0 1"}
