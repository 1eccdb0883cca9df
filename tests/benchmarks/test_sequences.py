"""Number and size of frames against error: what is run, how it is scored and told."""

import json
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import pytest

from benchmarks import documents, sequences
from benchmarks.cases import Case
from benchmarks.full_hd import write_scored_truth
from benchmarks.scenes.score import diffuse, lights, materials
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.document.images import read_exr, read_image, write_exr, write_png
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.presets import chain
from meshlab_svbrdf.script import check_script


def test_every_run_is_accepted_and_differs(tmp_path):
    tasks = sequences.tasks([Case("one", tmp_path), Case("two", tmp_path)], 64)
    assert len({(task.scene, task.name) for task in tasks}) == len(tasks)
    assert len({(task.scene, task.about) for task in tasks}) == len(tasks)
    for task in tasks:
        setup = task.make.args[1]
        check_script(chain(setup.estimator, setup.preset, setup.settings))


def test_the_workloads_truth_fed_with_itself_has_no_error(tmp_path):
    workload = make_workload(tmp_path, 2, Options(500, 160, 90, step=45.0, truth=64))
    truth, result = tmp_path / "truth", tmp_path / "result"
    write_scored_truth(workload, truth)
    views = read_project(truth / "views" / "project.mlp").rasters
    assert all(view.path.is_file() for view in views)

    (result / "maps").mkdir(parents=True)
    D = read_exr(truth / "diffuse_shaded.exr")
    ids, told = (
        read_image(truth / "material_id.png"),
        json.loads((truth / "lights.json").read_text()),
    )
    emitters = told["emitters"]
    mean = np.exp(np.mean([np.log(e["phong_intensity"]) for e in emitters]))
    found = [{"position": e["position"], "gain": e["phong_intensity"] / mean} for e in emitters]
    (result / "lights.json").write_text(json.dumps({"lights": found}))
    described = json.loads((truth / "materials.json").read_text())["materials"]
    table = np.full((256, 2), np.nan, np.float32)
    for m in described:
        table[m["id"]] = (m["rho_s"] * mean, m["alpha"]) if m["rho_s"] else np.nan
    write_exr(result / "maps" / "diffuse.exr", D)
    write_exr(result / "maps" / "rho_s.exr", table[ids, 0])
    write_exr(result / "maps" / "alpha.exr", table[ids, 1])
    write_png(result / "maps" / "valid.png", read_image(truth / "texel_mask.png"))

    scored = lights(result, truth, np.zeros(3)) | diffuse(result, truth) | materials(result, truth)
    assert (scored["lights_missed"], scored["lights_false"], scored["coverage"]) == (0, 0, 1)
    for key in ("light_deg_max", "ln_gain_max", "dE_mean", "ln_rho_s_worst", "ln_alpha_worst"):
        assert scored[key] == pytest.approx(0, abs=1e-5), key


def row(**given):
    material = {"ln_rho_s": "inf", "ln_alpha": "inf"}
    other = {"rho_s": 0.3, "alpha": 20.0, "ln_rho_s": -0.02, "ln_alpha": 0.01}
    made = {
        "part": "sequences", "scene": "s", "name": "n", "frames": 12, "reduce": 1, "width": 640,
        "step": 30.0, "megapixels": 3.7, "samples": 4.0, "least": 8, "coverage": None,
        "dE_mean": None, "lights": 2, "lights_false": 1, "light_deg_max": 0.5,
        "materials": [material, other], "psnr": 20.0, "psnr_highlights": 18.0, "cpu_seconds": 9.0,
    }  # fmt: skip
    return made | given


def test_what_was_not_found_counts_for_no_error_but_is_told():
    (made,) = sequences.tables([row(frames=24), row(), row(least=4), {
        "scene": "s", "name": "all frames", "error": "why"}])  # fmt: skip
    lines = made.markdown().splitlines()[4:]
    assert lines[0] == (
        "| 12 frames | 640 | 30.0 | 3.7 | 4 | – | – | 1 + 1 | 0.50 | 1 of 2 | -0.020 | +0.010 "
        "| 20.0 | 18.0 | 9 |"
    )
    assert lines[1].startswith("| 12, texels of 4 samples too |")
    assert lines[2].startswith("| 24 frames |")
    assert lines[3].startswith("| all frames | failed: why |")
    assert sequences.worst(row(materials=[]), "alpha") is None


def test_table_and_plot_go_into_the_documentation(monkeypatch, tmp_path):
    try:
        version("matplotlib")  # importing tells nothing: colour-science puts a dummy in its place
    except PackageNotFoundError:
        pytest.skip("the plot needs the extra [docs]")
    copy = tmp_path / "page.md"
    copy.write_bytes(documents.SEQUENCES.read_bytes())
    monkeypatch.setattr(documents, "SEQUENCES", copy)
    monkeypatch.setattr(documents, "SEQUENCES_PICTURE", tmp_path / "plot.png")
    monkeypatch.setattr(documents, "PAGE", tmp_path / "accuracy.md")
    (tmp_path / "accuracy.md").write_text("<!-- benchmark: presets -->\n<!-- end -->\n")
    rows = [row(coverage=c, dE_mean=1.0, frames=f) for f, c in ((12, 0.1), (24, 0.8))]
    documents.write_documents({sequences.PART: [*rows, row(width=320, reduce=2), row(error="why")]})
    assert "| 24 frames | 640 |" in copy.read_text()
    assert (tmp_path / "plot.png").stat().st_size > 10_000
