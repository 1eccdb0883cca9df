"""The benchmark's figures: complete, consistent, and what slopes and exponents mean."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from meshlab_svbrdf import cli
from meshlab_svbrdf.bench import child, first_run, huge, measure
from meshlab_svbrdf.bench.analysis import (
    TEXELS,
    VISIBILITY,
    exponent,
    exponents,
    roofline,
    slope,
)
from meshlab_svbrdf.bench.child import metered
from meshlab_svbrdf.bench.huge import growth
from meshlab_svbrdf.bench.machine import cores, machine
from meshlab_svbrdf.bench.machine import measure as measured
from meshlab_svbrdf.bench.measure import Wanted, benchmark
from meshlab_svbrdf.bench.score import diffuse_error
from meshlab_svbrdf.bench.sheets import huge_sheets, sheets, shown_sheet
from meshlab_svbrdf.bench.workload import Options, make_workload
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.threads import thread_count

TINY = Options(triangles=500, width=160, height=90, step=15.0, truth=64)
FIGURES = {"name", "seconds", "cpu_seconds", "peak", "own", "said"}


@pytest.fixture
def here(monkeypatch):
    """Runs in this process, without warming up: what is tested is not how long it takes."""
    asked = []

    def at_once(task, threads=None, environment=None, **arguments):
        asked.append((task, threads, arguments))
        with cores(threads):
            return json.loads(json.dumps(child.TASKS[task](**arguments)))

    monkeypatch.setattr(measure, "measure", at_once)
    monkeypatch.setattr(child, "warm_up", lambda *a: {"seconds": 0.0, "cpu_seconds": 0.0})
    took = {"seconds": 1.0, "cpu_seconds": 1.0}
    monkeypatch.setattr(measure, "first_run", lambda *a: {"first": took})
    return asked


def test_a_first_run_is_the_command_as_users_give_it():
    told = subprocess.run([*first_run.RUN, "--help"], check=True, capture_output=True, text=True)
    assert "--preset" in told.stdout


def test_everything_is_measured(tmp_path, here):
    wanted = Wanted(24, 64, "paper", slope=(12, 24), automatic=True, scaling=True)
    told = benchmark(wanted, TINY, tmp_path)
    assert json.dumps(told, allow_nan=False)
    run = told["runs"][0]
    assert [set(stage) for stage in run["stages"]] == [FIGURES] * len(run["stages"])
    assert [s["name"] for s in run["stages"]][-1] == "save"
    assert run["frames"] == run["frames_used"] == 24
    assert run["samples"] > 0
    assert 5 < run["store_bytes"] / run["samples"] < 10
    assert (
        run["texels"]
        == told["workload"]["texels"]
        == len(make_workload(tmp_path, 24, TINY).texels(64))
    )
    assert run["decode"]["frames"] == 24
    assert told["slope"]["frames"] == [12, 24]
    assert {"full", "standard"} == set(told["automatic"])
    assert [each["size"] for each in told["scaling"]] == ["frames", "texels"]
    assert told["scaling"][0]["sizes"] == [6, 12, 24]
    assert told["kernels"]["first"] == {"seconds": 1.0, "cpu_seconds": 1.0}
    # Every configuration ran once, and nothing of the runs is left
    runs = [json.dumps(arguments) for task, _, arguments in here if task == "chain"]
    assert len(set(runs)) == len(runs)
    assert not list(tmp_path.glob("*/runs-*"))
    titles = [sheet.title for sheet in sheets(told)]
    assert len(titles) == 6
    for sheet in sheets(told):
        assert {len(cells) for cells in sheet.cells} == {len(sheet.headings)}
        sheet.rich()


def test_growth_is_a_line_through_two_runs():
    def run(texels):
        peak, own = 5000 + 7 * texels, 4000 + 3 * texels
        stages = [{"name": "a", "peak": peak, "own": own, "cpu_seconds": 2 + texels / 100}]
        return {"texels": texels, "stages": stages, "disk": 3 * texels}

    found = growth(run(100), run(300), "texels", 1e6)
    (stage,) = found["stages"]
    assert (stage["by_peak"], stage["by_own"], found["by_disk"]) == (7, 3, 3)
    assert stage["aim_peak"] == pytest.approx(run(1e6)["stages"][0]["peak"])
    assert stage["aim_cpu"] == pytest.approx(run(1e6)["stages"][0]["cpu_seconds"])
    assert found["aim_disk"] == pytest.approx(3e6)


def test_a_huge_object_is_extrapolated(tmp_path, here, monkeypatch):
    monkeypatch.setattr(huge, "measure", measure.measure)
    monkeypatch.setattr(huge, "SURFACES", (300, 1200))
    told = huge.huge(16, 64, replace(TINY, step=22.5), tmp_path)
    assert json.dumps(told, allow_nan=False)
    assert told["texels"]["sizes"] == [run["texels"] for run in told["runs"]]
    assert told["triangles"]["sizes"][1] == pytest.approx(1200, rel=0.1)
    assert [s["name"] for s in told["triangles"]["stages"]] == [TEXELS, VISIBILITY]
    assert not list(tmp_path.glob("*/huge-*"))
    for sheet in huge_sheets(told):
        assert {len(cells) for cells in sheet.cells} == {len(sheet.headings)}
        sheet.rich()


def test_an_object_in_udim_tiles_is_run_once(tmp_path, here, monkeypatch):
    monkeypatch.setattr(huge, "measure", measure.measure)
    told = huge.shown(16, 32, replace(TINY, step=22.5), tmp_path)
    assert told["texels"] == pytest.approx(6 * (0.94 * 32) ** 2, rel=0.05)
    assert not list(tmp_path.glob("*/huge-*"))
    sheet = shown_sheet(told)
    assert {len(cells) for cells in sheet.cells} == {len(sheet.headings)}
    assert [cells[0] for cells in sheet.cells][-2:] == ["save", "whole"]


def test_two_numbers_of_threads_are_compared(tmp_path, here):
    count = thread_count()
    if count < 2:
        pytest.skip("one core")
    told = benchmark(Wanted(24, 32, "paper", threads=(1, 2), cold=False), TINY, tmp_path)
    assert [run["threads"] for run in told["runs"]] == [1, 2]
    assert told["second_core"]["gains"].keys() >= {"whole", "only decode"}
    assert thread_count() == count


def test_a_run_comes_near_the_truth(tmp_path, here):
    """Without noise and gloss aside, what the chain finds is what the frames were shaded by."""
    workload = make_workload(tmp_path, 48, replace(TINY, width=320, height=180, noise=0.0))
    child.run_chain(str(workload.project), str(tmp_path / "out"), "joint", "full",
                    {"compute_svbrdf_texels.texture_size": "64"})  # fmt: skip
    assert diffuse_error(workload, Document.open(next((tmp_path / "out").glob("*.mlp")))) < 1.5


def test_a_measurement_is_a_process_on_its_own_cores(tmp_path):
    workload = make_workload(tmp_path, 2, TINY)
    told = measured("decode", 1, project=str(workload.project))
    assert told["frames"] == 2
    assert told["threads"] == 1
    assert told["peak"] > 1 << 20
    with pytest.raises(SvbrdfError, match="ended with"):
        measured("decode", project=str(tmp_path / "nothing.mlp"))


def test_the_shell_makes_and_measures(tmp_path, here):
    small = ["--frames", "16", "--triangles", "500", "--width", "160", "--height", "90",
             "--step", "22.5", "--texture-size", "32", "--folder", str(tmp_path)]  # fmt: skip
    made = CliRunner().invoke(cli.app, ["bench", *small, "--only-make"])
    assert made.exit_code == 0, made.output
    assert len(Document.open(made.stdout.strip()).rasters) == 16
    file = tmp_path / "told.json"
    told = CliRunner().invoke(cli.app, ["bench", *small, "--no-cold", "--json", str(file)])
    assert told.exit_code == 0, told.output
    assert "only decode these frames" in told.stdout
    assert json.loads(file.read_text())["workload"]["frames"] == 16


def test_more_cores_than_there_are_is_refused():
    with pytest.raises(SvbrdfError, match="threads asked for"), cores(10_000):
        pass


def figures(frames, texels=1000, fixed=3.0, each=0.2):
    cost = dict.fromkeys(("seconds", "cpu_seconds"), fixed + each * frames)
    other = dict.fromkeys(("seconds", "cpu_seconds"), 0.1 * frames)
    stages = [{"name": "one"} | cost, {"name": "compute_svbrdf_samples"} | other]
    decode = dict.fromkeys(("seconds", "cpu_seconds"), 0.05 * frames)
    return {"frames": frames, "frames_used": frames, "texels": texels, "reduce": 1,
            "samples": 100 * frames,
            "stages": stages, "decode": decode}  # fmt: skip


def test_slope_tells_fixed_costs_from_costs_per_frame():
    found = slope(figures(300), figures(1200))["cpu_seconds"]
    assert found["per_frame"] == pytest.approx(0.3)
    assert found["fixed"] == pytest.approx(3.0)
    assert found["ratio"] == pytest.approx(6.0)
    assert found["stages"]["one"] == pytest.approx(0.2)
    assert found["fixed_stages"]["one"] == pytest.approx(3.0)


def test_exponents_of_powers():
    sizes = np.array([100, 300, 900])
    assert exponent(sizes, 0.01 * sizes**1.3) == pytest.approx(1.3)
    assert exponent([5, 5], [1, 2]) is None
    runs = [figures(n, fixed=0.0) for n in (10, 20, 40)]
    assert exponents(runs, "frames")["whole"] == pytest.approx(1.0)


def test_roofline_counts_pixels_where_frames_are_read():
    rates = {"copy_bytes": 1e9, "operations": 2e9, "cores": 2}
    one, samples = roofline(figures(10), rates, pixels=2000)
    assert one["bytes"] == 5
    assert samples["bytes"] == pytest.approx(5 + (3 * 2000 + 24 * 1000) / 100)
    assert one["operations"] == pytest.approx(one["nanoseconds"])


def test_the_machine_moves_and_adds():
    told = machine()
    assert told["cores"] == thread_count()
    assert told["copy_bytes"] > 1e8
    assert told["operations"] > 1e7


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is no file's")
def test_memory_is_seen_that_was_taken_between_two_looks_of_ours():
    with metered() as before:
        pass
    with metered() as figures:
        np.ones(64 << 20, np.uint8).tobytes()  # holds the interpreter
    assert figures["own"] >= before["own"] + (100 << 20)
    assert figures["peak"] >= figures["own"]
