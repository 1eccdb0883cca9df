"""The page's server: who may ask, what it answers, and how it refuses."""

import http.client
import json
from threading import Thread

import numpy as np
import pytest
from totems import WALK, copied

from meshlab_svbrdf.viewing.scene import Scene
from meshlab_svbrdf.viewing.server import HOST, PageServer
from meshlab_svbrdf.viewing.session import Session


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    session = Session(Scene(copied(tmp_path_factory, WALK, folder / "result").save()))
    with PageServer(session) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(page, path, *, method="GET", body=None, token="cookie", **headers):
    """Status, headers and body of an answer; token : by cookie, in the address, or not at all."""
    connection = http.client.HTTPConnection(HOST, page.server_port, timeout=60)
    headers = {"X-Svbrdf": "1"} | {k.replace("_", "-"): v for k, v in headers.items()}
    if token == "cookie":
        headers["Cookie"] = f"{page.cookie}={page.token}"
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    result = answer.status, answer.headers, answer.read()
    connection.close()
    return result


def told(page, path, **given):
    return json.loads(ask(page, path, **given)[2])


def post(page, path, given, **headers):
    status, _, body = ask(page, f"/api/{path}", method="POST", body=json.dumps(given), **headers)
    return status, json.loads(body)


def test_it_listens_on_loopback_alone(page):
    assert page.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize("path", ["/", "/main.js", "/api/scene", "/api/labels", "/?token=wrong"])
def test_without_the_token_nothing_is_told(page, path):
    status, headers, body = ask(page, path, token=None)
    assert status == 403
    assert "token" in json.loads(body)["message"]
    assert headers["Set-Cookie"] is None


def test_the_first_address_gives_the_cookie_that_further_ones_need(page):
    path = page.address.partition(str(page.server_port))[2]
    status, headers, body = ask(page, path, token=None)
    assert status == 200
    assert b"<!doctype html>" in body
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "script-src 'self'" in headers["Content-Security-Policy"]
    assert ask(page, "/main.js", token=None, Cookie=cookie.partition(";")[0])[0] == 200


def test_other_sites_and_other_names_are_refused(page):
    assert ask(page, "/api/scene", X_Svbrdf="0")[0] == 403
    assert ask(page, "/api/scene", Host="example.org")[0] == 403
    assert ask(page, "/", Host=f"localhost:{page.server_port}")[0] == 200
    revision = page.session.revision
    status, said = post(page, "merge", {"ids": [0, 1], "revision": revision}, X_Svbrdf="")
    assert (status, page.session.revision) == (403, revision)
    assert "page alone" in said["message"]


@pytest.mark.parametrize(
    "path",
    ["/../server.py", "/..%2fserver.py", "/page/../../cli.py", "//etc/passwd", "/%2e%2e/routes.py"],
)
def test_no_path_leads_out_of_the_page(page, path):
    assert ask(page, path)[0] == 404


def test_it_serves_the_scene_as_arrays(page):
    scene, told_of = page.session.scene, told(page, "/api/scene")
    assert told_of["texels"] == len(scene.texels)
    faces = sum(texture["faces"] for texture in told_of["textures"])
    assert faces == len(scene.mesh.faces)
    assert len(ask(page, "/api/geometry")[2]) == faces * 3 * (12 + 8 + 4)
    labels = np.frombuffer(ask(page, "/api/labels")[2], "<u2").astype(int)
    np.testing.assert_array_equal(np.where(labels == 65535, -1, labels), page.session.labels)
    pixels = np.frombuffer(ask(page, "/api/pixels?texture=0")[2], "<i4")
    pixels = pixels.reshape(scene.texels.sizes[0])
    own = np.arange(len(scene.texels))
    np.testing.assert_array_equal(pixels[scene.texels.row, scene.texels.col], own)
    status, headers, body = ask(page, "/api/map?name=samples")
    assert (status, len(body)) == (200, 3 * len(scene.texels))
    assert json.loads(headers["X-Legend"])["low"] > 0
    assert ask(page, "/api/script")[2].startswith(b"<!DOCTYPE FilterScript>")


@pytest.mark.parametrize(
    ("path", "given", "status", "says"),
    [
        ("pick", {"rays": [[0, 0, 99, 0, 0, 1]]}, 400, "nothing was picked"),
        ("pick", {"rays": "here"}, 400, "cannot do"),
        ("pick", {}, 400, "cannot do"),
        ("split", {"rays": [[0, 0, 99, 0, 0, 1]], "revision": 0}, 400, "misses the object"),
        ("merge", {"ids": [0], "revision": 0}, 400, "at least two"),
        ("merge", {"ids": [0, 1], "revision": -5}, 409, "another page"),
        ("merge", {"ids": [0, 77], "revision": 0}, 400, "no material 77"),
        ("undo", {"revision": 0}, 400, "nothing to undo"),
        ("nothing", {}, 404, "there is no"),
    ],
)
def test_bad_requests_are_told_why_and_change_nothing(page, path, given, status, says):
    before = page.session.labels.copy()
    answer, said = post(page, path, given)
    assert answer == status
    assert says in said["message"]
    np.testing.assert_array_equal(page.session.labels, before)
    assert not page.session.dirty


def test_what_is_no_json_or_too_long_is_refused(page):
    assert ask(page, "/api/merge", method="POST", body="[]")[0] == 400
    assert ask(page, "/api/merge", method="POST", body="{")[0] == 400
    assert ask(page, "/api/merge", method="POST", Content_Length=str(1 << 40))[0] == 413
    assert ask(page, "/api/merge", method="POST", Content_Length="9" * 5000)[0] == 413
    assert ask(page, "/api/merge", method="POST", Content_Length="-1")[0] == 413
    assert ask(page, "/api/merge", method="POST", body="[" * 200_000)[0] == 400


def test_edits_go_by_the_page(page):
    revision = page.session.revision
    status, state = post(page, "merge", {"ids": [0, 1], "revision": revision})
    assert (status, state["dirty"], state["undo"]) == (200, True, "merged 0, 1")
    assert 1 not in {cluster["id"] for cluster in state["clusters"]}
    status, state = post(page, "undo", {"revision": state["revision"]})
    assert (status, state["dirty"], state["redo"]) == (200, False, "merged 0, 1")
