"""The relighting benchmark: what scales away, what is timed, and its tables."""

import numpy as np
import pytest
from totems import VIDEO, film

from benchmarks import documents, relighting
from benchmarks.scenes.score import albedo
from meshlab_svbrdf.bench.workload import Options
from meshlab_svbrdf.document.images import read_image, write_exr
from meshlab_svbrdf.samples.luminance import decode


@pytest.fixture
def truth(tmp_path_factory):
    return film(tmp_path_factory, VIDEO).parent / "ground_truth"


def test_the_truth_in_another_exposure_is_without_error(truth):
    class Truth:
        def __init__(self, scale):
            self.scale = scale

        def render(self, camera, supersampling):
            codes = read_image(truth / "views" / "view_00.png")[..., :3]
            return self.scale * decode(codes / 255), np.ones(codes.shape[:2])

    assert relighting._views(Truth(0.4), truth / "views") > 60
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relighting, "CLIPPED", 2.0)
        assert relighting._views(Truth(0.4), truth / "views") > 100


def test_albedo_is_judged_up_to_one_scale(truth, tmp_path):
    true = decode(read_image(truth / "albedo.png")[..., :3] / 255)
    write_exr(tmp_path / "same.exr", (0.3 * true).astype(np.float32))
    found = albedo(tmp_path / "same.exr", truth)
    assert found["coverage"] == 1
    assert found["dE_mean"] < 1e-3
    holes = true.astype(np.float32)
    holes[::2] = np.nan
    write_exr(tmp_path / "holes.exr", holes)
    assert albedo(tmp_path / "holes.exr", truth)["coverage"] < 0.6
    write_exr(tmp_path / "other.exr", (true**2).astype(np.float32))
    assert albedo(tmp_path / "other.exr", truth)["dE_mean"] > 1
    write_exr(tmp_path / "none.exr", np.full_like(holes, np.nan))
    assert albedo(tmp_path / "none.exr", truth)["dE_mean"] is None


def test_pictures_of_the_workload_are_timed(tmp_path, monkeypatch):
    monkeypatch.setattr(relighting, "SIZES", {"small": (32, 18, 1), "large": (64, 36, 1)})
    options = Options(triangles=2000, truth=32)
    row = relighting._times_of_workload(64, tmp_path, options, tmp_path)
    assert row["faces"] > 1000
    assert [(t["light"].split()[-1], t["size"]) for t in row["times"]] == [
        ("found", "small"), ("found", "large"), ("lights", "small"), ("lights", "large"),
    ]  # fmt: skip
    assert all(t["seconds"] > 0 for t in row["times"])
    judged = {
        "scene": "s", "name": "albedo", "relight_single": 36.54, "relight_env": "inf",
        "dE_mean": 1.0, "dE_median": 0.5, "coverage": 0.99,
    }  # fmt: skip
    of_light, of_time = relighting.tables([judged, row | {"scene": "workload", "name": "time"}])
    assert of_light.cells == [["s", "albedo", "36.5", "∞", "1.00", "0.50", "99.0%"]]
    assert len(of_time.cells) == 4
    pages = {}
    monkeypatch.setattr(documents, "splice", lambda page, name, text: pages.update({name: text}))
    documents.write_documents({relighting.PART: [judged, row | {"scene": "w", "name": "time"}]})
    assert "36.5" in pages["relighting"]
    assert "large, 64×36" in pages["rendering"]
