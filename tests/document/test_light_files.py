"""Lights in JSON: a result's own, a scene's, and what is wrong with others."""

import json

import numpy as np
import pytest

from meshlab_svbrdf.document.light_files import read_light_file
from meshlab_svbrdf.errors import DocumentError


def written(tmp_path, content):
    path = tmp_path / "lights.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_results_own_form(tmp_path):
    told = {
        "lights": [
            {"direction": [0, 0, 2], "position": None, "gain": 1.5, "covariance": [[1, 0], [0, 1]]},
            {"direction": [1, 0, 0], "position": [4, 0, 1], "gain": 0.5, "color": [1, 0.5, 0]},
        ],
        "ambient": [0.1, 0.2, 0.3],
    }
    found = read_light_file(written(tmp_path, told))
    far, near = found.lamps
    np.testing.assert_array_equal(far.direction, [0, 0, 1])
    assert far.position is None
    np.testing.assert_array_equal(far.color, [1.5] * 3)
    np.testing.assert_array_equal(near.position, [4, 0, 1])
    np.testing.assert_array_equal(near.color, [0.5, 0.25, 0])
    assert not near.in_radii
    np.testing.assert_array_equal(found.ambient, [0.1, 0.2, 0.3])


def test_a_scenes_form(tmp_path):
    told = {
        "emitters": [{"position": [0, 12, 0], "phong_intensity": [2, 2, 1]}],
        "ambient_radiance": [0.05] * 3,
    }
    found = read_light_file(written(tmp_path, told))
    assert found.lamps[0].in_radii
    np.testing.assert_array_equal(found.lamps[0].color, [2, 2, 1])
    np.testing.assert_array_equal(found.ambient, [0.05] * 3)
    told["units"] = "positions in world units, distances in object radii"
    assert not read_light_file(written(tmp_path, told)).lamps[0].in_radii


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "no JSON"),
        ("[]", "at least one light"),
        ({"lights": []}, "at least one light"),
        ({"lights": [3]}, "light 0: expected an object"),
        ({"emitters": [{"position": [0, 2, 0]}]}, "light 0: an emitter needs its phong_intensity"),
        ({"lights": [{}]}, "light 0: expected a direction"),
        ({"lights": [{"direction": [0, 0, 0]}]}, "light 0: expected a direction"),
        ({"lights": [{"direction": [0, 1]}]}, "direction is .* expected three numbers"),
        ({"lights": [{"direction": ["a", 0, 1]}]}, "expected three numbers"),
        ('{"lights": [{"position": [NaN, 0, 1]}]}', "expected three numbers"),
        ({"lights": [{"direction": [0, 0, 1], "gain": -1}]}, "gain is -1"),
        ({"lights": [{"direction": [0, 0, 1], "gain": "x"}]}, "gain is 'x'"),
        ({"lights": [{"direction": [0, 0, 1], "color": [-1, 0, 0]}]}, "color is negative"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path, content, said):
    path = written(tmp_path, content)
    with pytest.raises(DocumentError, match=said) as error:
        read_light_file(path)
    assert "lights.json" in str(error.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(DocumentError, match="cannot be read"):
        read_light_file(tmp_path / "none.json")
