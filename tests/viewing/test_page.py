"""The page itself, in a real headless Chromium: look, pick, merge, split, undo, name, save.

What is saved is compared with the clusters that the filters make of the same edits.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from totems import DIFFUSE, WALK, copied, film, run, sized

from benchmarks.page import serving
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.filters._materials import read_edits, read_names
from meshlab_svbrdf.reflectance.edit import merge
from meshlab_svbrdf.reflectance.material_edits import Split, perform
from meshlab_svbrdf.viewing.picking import hits
from meshlab_svbrdf.viewing.scene import Scene
from meshlab_svbrdf.viewing.session import Session
from meshlab_svbrdf.viewing.shots import lens, raster

playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright's Python package")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
SIZE = {"width": 1280, "height": 800}

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium on the PATH")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as player:
        chromium = player.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield chromium
        chromium.close()


@pytest.fixture
def served(tmp_path_factory, tmp_path):
    project = copied(tmp_path_factory, WALK, tmp_path / "result").save()
    with serving(Session(Scene(project))) as server:
        yield server


@pytest.fixture
def project(served) -> Path:
    return served.session.scene.document.path


@pytest.fixture
def problems() -> list[str]:
    """What the page's own console complains of."""
    return []


@pytest.fixture
def page(browser, served, problems):
    yield opened(browser, served, problems)
    assert problems == []


def opened(browser, served, problems):
    page = browser.new_context(viewport=SIZE).new_page()
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: _only_here(request.url, problems))
    page.goto(served.address)
    page.wait_for_selector("body[data-ready]")
    return page


def _only_here(url: str, problems: list[str]) -> None:
    if not url.startswith(("http://127.0.0.1", "data:", "blob:")):
        problems.append(f"asked for {url}")


def screen(page, point) -> tuple[float, float]:
    """The pixel of a point of the world: the page's own camera, as it stands at the start."""
    return tuple(
        page.evaluate(
            """async (point) => {
                const { Camera } = await import("/camera.js");
                const { get } = await import("/api.js");
                const scene = await get("scene");
                const view = document.getElementById("view"), camera = new Camera();
                camera.size = [view.clientWidth, view.clientHeight];
                return camera.project(point.map((x, i) => (x - scene.center[i]) / scene.radius));
            }""",
            [float(x) for x in point],
        )
    )


def visible(page, session, cluster: int) -> tuple[float, float]:
    """A pixel that shows a cluster, far from its border on the screen."""
    scene, rng = session.scene, np.random.default_rng(1)
    own = rng.permutation(np.flatnonzero(session.labels == cluster))[:60]
    best, most = None, -1
    for texel in own:
        x, y = screen(page, scene.place(texel))
        around = [cluster_at(page, session, x + dx, y + dy) for dx, dy in AROUND]
        if around[0] == cluster and around.count(cluster) > most:
            best, most = (x, y), around.count(cluster)
        if most == len(AROUND):
            break
    assert best is not None, f"cluster {cluster} is not in sight"
    return best


AROUND = [(0, 0), (3, 0), (-3, 0), (0, 3), (0, -3)]


def ray(page, x, y) -> np.ndarray:
    found = page.evaluate(
        """async ([x, y]) => {
            const { Camera } = await import("/camera.js");
            const view = document.getElementById("view"), camera = new Camera();
            camera.size = [view.clientWidth, view.clientHeight];
            return camera.ray(x, y);
        }""",
        [x, y],
    )
    return np.array(found)


def cluster_at(page, session, x, y) -> int:
    scene = session.scene
    eye, direction = ray(page, x, y)
    met = hits(session, eye * scene.texels.radius + scene.texels.center, direction)
    if not len(met):
        return -2
    return int(session.labels[scene.graph.tree.query(met[0] - scene.texels.center)[1]])


def shown(page, selector) -> str:
    return page.locator(selector).inner_text()


def wait_for(page, words: str) -> None:
    page.wait_for_function(
        "words => document.getElementById('message').textContent.toLowerCase().includes(words)",
        arg=words.lower(),
    )


def in_sight(page, session, least=2) -> list[int]:
    """Clusters seen on a grid of pixels, the commonest first."""
    grid = [(x, y) for x in range(300, 700, 40) for y in range(100, 720, 40)]
    found = [cluster_at(page, session, x, y) for x, y in grid]
    ids, count = np.unique([k for k in found if k >= 0], return_counts=True)
    assert len(ids) >= least
    return ids[np.argsort(-count)].tolist()


def test_look_pick_merge_split_undo_name_and_save(page, served, project):
    session = served.session
    start = session.labels.copy()
    first, second = in_sight(page, session)[:2]

    # Pick: cluster, numbers, both plots
    page.mouse.click(*visible(page, session, first))
    page.wait_for_selector("#density:not([hidden]) .plot > *")
    page.wait_for_selector("#history:not([hidden]) svg")
    assert f"material {first}" in shown(page, "#point-cluster")
    assert "samples" in shown(page, "#numbers")
    assert page.locator("#clusters li.selected").get_attribute("data-id") == str(first)
    assert page.locator("#merge").is_disabled()

    # Merge two
    page.keyboard.down("Control")
    page.mouse.click(*visible(page, session, second))
    page.keyboard.up("Control")
    page.wait_for_function("() => document.querySelectorAll('#clusters li.selected').length === 2")
    page.click("#merge")
    wait_for(page, "merged")
    merged = merge(start, [first, second])
    np.testing.assert_array_equal(session.labels, merged)

    # Undo, and again by the keys
    page.click("#undo")
    wait_for(page, "Undone")
    np.testing.assert_array_equal(session.labels, start)
    page.keyboard.press("Control+Shift+Z")
    page.wait_for_function("() => document.getElementById('redo').disabled")
    np.testing.assert_array_equal(session.labels, merged)

    # Split the merged one by a stroke from beyond the object to beyond it, and behind it
    page.click("#tool-stroke")
    page.check("#through")
    y = visible(page, session, min(first, second))[1]
    page.mouse.move(20, y)
    page.mouse.down()
    page.mouse.move(1000, y + 6, steps=120)
    page.mouse.up()
    page.wait_for_function(
        "() => document.getElementById('message').textContent.match(/^Split|divide/)"
    )
    assert "divide" not in shown(page, "#message")
    edit = session.state.edits[-1]
    assert isinstance(edit, Split)
    expected = perform(merged, edit, session.scene.canvas)
    np.testing.assert_array_equal(session.labels, expected)

    # Name and save
    identity = int(np.unique(expected)[-1])
    page.fill(f'#clusters li[data-id="{identity}"] input', "a new half")
    page.keyboard.press("Enter")
    wait_for(page, "named")
    page.keyboard.press("Escape")
    page.click("#save")
    wait_for(page, "saved to")
    document = Document.open(project)
    np.testing.assert_array_equal(document.attribute("material"), expected)
    assert read_names(document) == {identity: "a new half"}
    assert len(read_edits(document)) == 2
    assert shown(page, "#save") == "Saved"


def test_every_map_is_drawn_and_another_threshold_previewed(page, served):
    session = served.session
    before = page.locator("#stage").screenshot()
    for option in page.locator("#map option").all():
        name = option.get_attribute("value")
        if name == "materials":
            continue
        with page.expect_response(f"**/api/map?name={name}*") as answer:
            page.select_option("#map", name)
        assert answer.value.ok
        page.wait_for_timeout(100)
        assert page.locator("#stage").screenshot() != before
    page.select_option("#map", "materials")
    labels = session.labels.copy()
    with page.expect_response("**/api/preview?threshold=4"):
        page.locator("#threshold").fill("4")
    page.wait_for_function("() => !document.getElementById('find').disabled")
    np.testing.assert_array_equal(session.labels, labels)
    page.click("#find")
    wait_for(page, "found with threshold 4")
    assert len(np.unique(session.labels)) > len(np.unique(labels))


def test_what_goes_wrong_is_said_and_nothing_is_lost(page, served):
    session = served.session
    before = session.labels.copy()
    page.mouse.click(30, 400)
    wait_for(page, "nothing was picked")
    page.click("#tool-stroke")
    page.mouse.move(20, 300)
    page.mouse.down()
    page.mouse.move(20, 500, steps=10)
    page.mouse.up()
    wait_for(page, "misses the object")
    x, y = visible(page, session, in_sight(page, session)[0])
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 8, y, steps=4)
    page.mouse.up()
    wait_for(page, "does not divide")
    np.testing.assert_array_equal(session.labels, before)


def test_a_stroke_goes_on_after_the_object_was_turned(page, served):
    """Its pieces are cut at once, each by the rays of where it was drawn."""
    page.click("#tool-stroke")
    page.keyboard.down("Shift")
    page.mouse.move(330, 400)
    page.mouse.down()
    page.mouse.move(630, 410, steps=20)
    with page.expect_response("**/api/hits") as told:
        page.mouse.up()
    assert told.value.json()["points"]
    page.mouse.move(500, 300)
    page.mouse.down(button="right")
    page.mouse.move(640, 300, steps=4)
    page.mouse.up(button="right")
    page.mouse.move(500, 400)
    page.mouse.down()
    page.keyboard.up("Shift")
    page.mouse.move(640, 410, steps=20)
    with page.expect_request("**/api/split") as asked:
        page.mouse.up()
    rays = np.array(asked.value.post_data_json["rays"])
    eyes, count = np.unique(np.round(rays[:, :3], 9), axis=0, return_counts=True)
    assert len(eyes) == 2
    assert count.min() > 10


def test_it_looks_as_a_frame_did_with_the_frame_beside(page, served):
    """A point is where the frame's camera has it, in views of any shape."""
    scene, frame = served.session.scene, 3
    shot, texels = raster(scene, frame).camera, scene.texels
    shot = replace(shot, cx=shot.cx + 9.0, cy=shot.cy - 5.0)
    point = texels.position[::500] + texels.center
    expected = shot.project(point)[:, :2] + 0.5
    told = lens(shot, texels)
    for width, height in ((shot.width, shot.height), (3 * shot.width, shot.height), (200, 900)):
        found = page.evaluate(
            """async ([lens, points, size]) => {
                const { Camera } = await import("/camera.js");
                const camera = new Camera();
                camera.size = size;
                camera.stand(lens);
                const [x, y] = camera.project(points[0]), [eye, way] = camera.ray(x, y);
                const m = camera.matrix(), p = [...points[0], 1];
                const row = (r) => p.reduce((s, v, c) => s + v * m[4 * c + r], 0);
                const clip = [0, 1, 2, 3].map(row);
                return [points.map((q) => camera.project(q)), eye, way, clip];
            }""",
            [told, ((point - texels.center) / texels.radius).tolist(), [width, height]],
        )
        pixels, eye, way, clip = map(np.array, found)
        scale = min(width / shot.width, height / shot.height)
        middle = (np.array([width, height]) - scale * np.array([shot.width, shot.height])) / 2
        np.testing.assert_allclose(pixels, scale * expected + middle, atol=1e-3)
        drawn = (clip[:2] / clip[3] * [1, -1] + 1) / 2 * [width, height]
        np.testing.assert_allclose(drawn, pixels[0], atol=1e-2)
        toward = (point[0] - texels.center) / texels.radius - eye
        np.testing.assert_allclose(np.cross(toward, way), 0, atol=1e-6)

    # The button
    before = page.evaluate("document.getElementById('view').clientWidth")
    page.select_option("#map", "frame")
    page.locator("#frame").fill("3")
    with page.expect_response("**/api/picture?frame=3") as answer:
        page.click("#stand")
    assert answer.value.headers["content-type"] == "image/jpeg"
    width, height = shot.width, shot.height
    page.wait_for_function(
        "([w, h]) => document.querySelector('#shot canvas').width === w", arg=[width, height]
    )
    assert page.locator("#shot canvas").evaluate("canvas => canvas.height") == height
    assert scene.frames[3] in shown(page, "#shot figcaption")
    assert page.evaluate("document.getElementById('view').clientWidth") == before // 2
    with page.expect_response("**/api/picture?frame=4"):
        page.locator("#frame").fill("4")
    page.select_option("#map", "materials")
    page.wait_for_selector("#shot", state="hidden")


def test_a_frame_that_is_gone_is_said_and_its_camera_still_stands(page, served, tmp_path):
    scene = served.session.scene
    entry = raster(scene, 2)
    gone = replace(entry, path=tmp_path / "gone.png")
    scene.document.project.rasters[scene.document.project.rasters.index(entry)] = gone
    page.select_option("#map", "frame")
    page.locator("#frame").fill("2")
    page.click("#stand")
    page.locator("#shot figcaption", has_text="gone").wait_for()
    assert page.locator("#stand").get_attribute("aria-pressed") == "true"


def test_a_project_without_materials_says_so_and_finds_them(
    tmp_path_factory, tmp_path, browser, problems
):
    document = Document.open(film(tmp_path_factory, WALK), tmp_path / "early")
    run(document, DIFFUSE, **sized(WALK))
    document.save()
    with serving(Session(Scene(document.path))) as server:
        page = opened(browser, server, problems)
        wait_for(page, "no materials yet")
        page.click("#tool-stroke")
        page.mouse.move(250, 400)
        page.mouse.down()
        page.mouse.move(650, 410, steps=20)
        page.mouse.up()
        wait_for(page, "there are no clusters to split")
        with page.expect_response("**/api/preview?threshold=10"):
            page.locator("#threshold").fill("10.5")
            page.locator("#threshold").fill("10")
        page.wait_for_function("() => !document.getElementById('find').disabled")
        page.click("#find")
        wait_for(page, "found with threshold 10")
        assert page.locator("#clusters li").count() == len(server.session.clusters()) > 1
    assert problems == []


def test_two_pages_on_one_project(page, served, browser, problems):
    """The second learns what the first did, and an edit that came too late is refused, not lost."""
    session, other = served.session, opened(browser, served, problems)
    ids = [cluster["id"] for cluster in session.clusters()][:3]
    for window in (page, other):
        window.click(f'#clusters li[data-id="{ids[0]}"]')
        window.click(f'#clusters li[data-id="{ids[1]}"]', modifiers=["Control"])
    session.merge(ids[::2])  # as a third page, of which neither knows yet
    late = page.evaluate(
        """async (ids) => (await fetch("/api/merge", {method: "POST",
            headers: {"X-Svbrdf": "1"}, body: JSON.stringify({ids, revision: 0})})).status""",
        ids[:2],
    )
    assert late == 409
    for window in (page, other):
        window.bring_to_front()
        window.wait_for_selector(f'#clusters li[data-id="{ids[2]}"]', state="detached")


def test_a_browser_without_the_token_is_told_so(browser, served):
    page = browser.new_context().new_page()
    answer = page.goto(served.address.partition("?")[0])
    assert answer.status == 403
    assert "token" in page.content()
