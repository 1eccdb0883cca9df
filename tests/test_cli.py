"""The shell: what it prints, where it writes, how it ends."""

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from meshlab_svbrdf import cli
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.record import ResultFolder
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.filter import Filter

pytestmark = pytest.mark.usefixtures("demos")

CHAIN = """<FilterScript><filter name="compute_demo_texels"/>
<filter name="compute_demo_shade"><Param name="fail" value="{fail}"/></filter></FilterScript>"""


@pytest.fixture
def chain(tmp_path):
    def write(fail: str = "no") -> str:
        path = tmp_path / f"{fail}.mlx"
        path.write_text(CHAIN.format(fail=fail))
        return str(path)

    return write


def shell(*words):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def test_a_run_prints_a_line_for_each_stage_and_what_to_open(small_project, tmp_path, chain):
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["compute_demo_texels", "compute_demo_shade"]
    assert lines[1].endswith("shaded")
    assert lines[-1] == f"Open {tmp_path / 'out' / 'small.mlp'} in MeshLab."
    labels = [layer.label for layer in Document.open(tmp_path / "out" / "small.mlp").layers]
    assert labels == ["stone", "map: height", "texels"]
    again = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert [line.split()[-1] for line in again.stdout.splitlines()[:2]] == ["unchanged"] * 2


def test_json_is_all_that_is_printed_when_asked(small_project, tmp_path, chain):
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain(), "--json")
    told = json.loads(result.stdout)
    assert told["project"] == str(tmp_path / "out" / "small.mlp")
    assert [stage["name"] for stage in told["stages"]] == [
        "compute_demo_texels",
        "compute_demo_shade",
    ]
    assert told["stages"][1].keys() >= {"message", "seconds", "cpu_seconds", "skipped"}


def test_an_error_is_one_message_and_what_was_finished_is_saved(small_project, tmp_path, chain):
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain("error"))
    assert result.exit_code == 1
    assert "Error: the demo fails as asked" in result.stderr
    assert "Traceback" not in result.output
    assert [x.label for x in Document.open(tmp_path / "out" / "small.mlp").layers] == [
        "stone",
        "texels",
    ]
    told = shell("run", small_project, "-o", tmp_path / "out", "--script", chain("error"), "--json")
    assert [stage["skipped"] for stage in json.loads(told.stdout)["stages"]] == [True]


def test_an_interrupted_run_ends_with_130_and_goes_on_later(small_project, tmp_path, chain):
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain("interrupt"))
    assert result.exit_code == 130
    assert "goes on from there" in result.stderr
    again = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert again.stdout.splitlines()[0].endswith("unchanged")
    assert again.exit_code == 0


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["run"],
        ["run", "x.mlp"],
        ["walk"],
        ["run", "x.mlp", "-o", "y", "--texture-size", "big"],
        ["run", "x.mlp", "-o", "y", "--estimator", "both"],
        ["run", "x.mlp", "-o", "y", "--estimator", "joint", "--script", "z.mlx"],
    ],
)
def test_wrong_usage_ends_with_2(words):
    assert shell(*words).exit_code == 2


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["info", "nowhere.mlp"], "nowhere.mlp"),
        (["info", "frames.zip"], "expected a MeshLab project"),
        (["filters", "compute_demo_texel"], "did you mean compute_demo_texels"),
        (
            ["apply", "{project}", "compute_demo_texels", "size"],
            "expected name=value, found 'size'",
        ),
        (["apply", "{project}", "compute_demo_texels", "size=1"], "expected a whole number from 4"),
        (["apply", "{project}", "compute_demo_shade"], "run compute_demo_texels first"),
        (
            ["run", "{project}", "-o", "{out}", "--script", "{chain}", "--texture-size", "64"],
            "no compute_svbrdf_texels",
        ),
        (
            ["run", "{project}", "-o", "{out}", "--script", "{chain}", "--layer", "x"],
            "no mesh layer 'x'",
        ),
    ],
)
def test_errors_of_the_input_end_with_1_and_say_what_to_do(
    small_project, tmp_path, chain, words, says
):
    names = {"project": small_project, "out": tmp_path / "out", "chain": chain()}
    result = shell(*(word.format(**names) for word in words))
    assert result.exit_code == 1
    assert says in " ".join(result.stderr.split())
    assert "Traceback" not in result.output


def test_one_filter_is_applied_in_place_or_elsewhere(small_project, tmp_path):
    result = shell(
        "apply", small_project, "compute_demo_texels", "size=8", "-o", tmp_path / "o.mlp"
    )
    assert result.exit_code == 0, result.output
    assert not small_project.with_suffix(".svbrdf").exists()
    assert ResultFolder(tmp_path / "o.svbrdf").record["runs"]["compute_demo_texels"][
        "parameters"
    ] == {"size": 8}
    assert shell("apply", tmp_path / "o.mlp", "compute_demo_shade").exit_code == 0
    assert shell("apply", small_project, "compute_demo_texels").exit_code == 0
    assert small_project.with_suffix(".svbrdf").exists()


def test_filters_are_listed_and_described(demos):
    listed = shell("filters").stdout.splitlines()
    assert [line.split()[0] for line in listed] == list(demos)
    assert (
        "| `size` | `16` | a whole number from 4 to 64 (pixels) |"
        in shell("filters", "compute_demo_texels").stdout
    )
    described = json.loads(shell("filters", "--json").stdout)
    assert [filter["id"] for filter in described] == list(demos)
    assert json.loads(shell("filters", "compute_demo_texels", "--json").stdout) == described[0]


def test_info_tells_what_is_there_and_what_is_older(small_project, tmp_path, chain):
    shell("run", small_project, "-o", tmp_path / "out", "--script", chain(), "--hold-out")
    project = tmp_path / "out" / "small.mlp"
    shell("apply", project, "compute_demo_texels", "size=8")
    told = json.loads(shell("info", project, "--json").stdout)
    assert told["rasters"] == 9
    assert told["held_out"] == 1
    assert told["layers"]["stone"] == "4 vertices, 4 faces"
    states = {name: product["state"] for name, product in told["products"].items()}
    assert states == {"texels": "up to date", "shade": "older than the texels"}
    assert "result   shade: shaded (older than the texels)" in shell("info", project).stdout


def test_info_tells_where_results_are_what_to_run_and_the_materials(small_project, tmp_path, demos):
    lines = shell("info", small_project).stdout.splitlines()
    assert f"results  {small_project.with_suffix('.svbrdf')}: none yet" in lines

    table = [
        {"id": 0, "texels": 12345, "observed": True, "rho_s": 0.25, "alpha": 40.0},
        {"id": 7, "texels": 9, "observed": False, "rho_s": None, "reason": "no peak"},
    ]
    demos["fit"] = Filter(
        "fit", "Fit", ("texels",), ("material_specular",),
        apply=lambda document, *_: document.set_json("materials", {"materials": table}),
    )  # fmt: skip
    for filter in ("compute_demo_texels", "fit"):
        shell("apply", small_project, filter)
    document = Document.open(small_project)
    document.hold_out()
    document.apply("compute_demo_texels", size=8)
    lines = shell("info", small_project).stdout.splitlines()
    assert "held out f3.png" in lines
    assert f"results  {small_project.with_suffix('.svbrdf')}" in lines
    assert "stale    material_specular: run fit again" in lines
    assert "material 0: 12,345 texels, rho_s 0.25, alpha 40" in lines
    assert "material 7: 9 texels, unobserved: no peak" in lines
    assert json.loads(shell("info", small_project, "--json").stdout)["materials"] == table


@pytest.mark.parametrize("place", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_that_kernels_are_compiled_is_known_wherever_numba_keeps_them(tmp_path, place):
    code = (
        "import numpy as np\n"
        "from meshlab_svbrdf.kernels import compiled, is_compiled\n"
        "from meshlab_svbrdf.geometry import texels\n"
        "print(is_compiled(texels._cover), compiled())\n"
        "texels._cover(np.zeros((0, 3, 2)), np.zeros(0, np.int64), np.zeros((4, 4), np.int32),\n"
        "              np.zeros((4, 4, 3), np.float32))\n"
        "print(is_compiled(texels._cover), compiled())\n"
    )
    package = tmp_path / "copy" / "meshlab_svbrdf"
    shutil.copytree(
        Path(cli.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    if place == "XDG_CACHE_HOME":  # numba goes there where it cannot write beside the source
        (package / "geometry" / "__pycache__").write_text("in the way")
    environment = {**os.environ, place: str(tmp_path / "cache"), "PYTHONPATH": str(package.parent)}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    if place != "NUMBA_CACHE_DIR":  # it would come first
        environment.pop("NUMBA_CACHE_DIR", None)
    told = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert told.stdout.splitlines() == ["False False", "True False"]
    assert list((tmp_path / "cache").rglob("*.nbi"))


def test_a_run_does_not_replace_the_users_project(small_project, chain):
    before = small_project.read_bytes()
    result = shell("run", small_project, "-o", small_project.parent, "--script", chain())
    assert result.exit_code == 1
    assert "would replace" in result.stderr
    assert small_project.read_bytes() == before


def test_a_parameter_of_the_chain_is_set(small_project, tmp_path, chain):
    words = ("run", small_project, "-o", tmp_path / "out", "--script", chain())
    result = shell(*words, "--set", "compute_demo_texels.size=1")
    assert result.exit_code == 1
    assert "expected a whole number from 4" in result.stderr
    result = shell(*words, "--set", "compute_demo_texels.size=8")
    assert result.exit_code == 0, result.output
    told = Document.open(tmp_path / "out" / "small.mlp").results.record["runs"]
    assert told["compute_demo_texels"]["parameters"]["size"] == 8


def test_two_runs_on_one_output_do_not_mix(small_project, tmp_path, chain):
    folder = ResultFolder(tmp_path / "out" / "small.svbrdf")
    with folder.locked():
        result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert result.exit_code == 75
    assert "another run" in result.stderr


@pytest.mark.parametrize(
    "lack",
    [
        MemoryError(), RuntimeError("can't start new thread"),
        cv2.error("OpenCV(4.10): Failed to allocate 99 bytes"),
    ],
    ids=["NumPy", "threads", "OpenCV"],
)  # fmt: skip
def test_where_memory_runs_out_one_message_says_what_to_make_smaller(
    small_project, tmp_path, chain, demos, monkeypatch, lack
):
    def apply(document, parameters, progress):
        raise lack

    if isinstance(lack, cv2.error):
        lack.code = cv2.Error.StsNoMem
    shade = demos["compute_demo_shade"]
    monkeypatch.setitem(demos, shade.name, replace(shade, apply=apply))
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].startswith("Error: there is not enough memory: use a sma")
    assert "finished stages are kept" in result.stderr
    record = Document.open(tmp_path / "out" / "small.mlp").results.record
    assert list(record["products"]) == ["texels"]


@pytest.mark.parametrize(
    "lack", [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory"), OSError("no")]
)
def test_where_a_file_finds_no_memory_the_message_names_it_and_says_what_to_make_smaller(
    small_project, tmp_path, chain, demos, monkeypatch, lack
):
    def apply(document, parameters, progress):
        try:
            raise lack
        except (MemoryError, OSError):
            raise DocumentError("a.npy: cannot be read") from None

    shade = demos["compute_demo_shade"]
    monkeypatch.setitem(demos, shade.name, replace(shade, apply=apply))
    result = shell("run", small_project, "-o", tmp_path / "out", "--script", chain())
    assert result.exit_code == 1
    said = "; there is not enough memory: use a smaller texture" in result.stderr
    assert "a.npy: cannot be read" in result.stderr
    assert said == (str(lack) != "no")


@pytest.mark.skipif(os.name != "posix", reason="limits of address space are POSIX's")
def test_too_little_address_space_for_the_libraries_is_told_before_they_crash(small_project):
    done = limited(["info", str(small_project)], "resource.RLIMIT_AS", 1 << 30)
    assert done.returncode == 1
    assert done.stderr.startswith("Error: this shell gives programs 1024 MB of address space")
    assert done.stderr.count("\n") == 1


def limited(words, name, value):
    """The command in a process of its own, under a limit."""
    code = (
        f"import resource, sys; resource.setrlimit({name}, ({value}, {value}))\n"
        "from meshlab_svbrdf import cli; cli.main()"
    )
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, capture_output=True, text=True)


def ordinary(words):
    """The command without root's right to write where nobody may."""
    command = [sys.executable, "-c", "from meshlab_svbrdf import cli; cli.main()", *words]
    if os.geteuid() == 0:
        command = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", *command]
    return subprocess.run([str(word) for word in command], capture_output=True, text=True)


@pytest.mark.skipif(
    os.name != "posix" or (os.geteuid() == 0 and not shutil.which("setpriv")),
    reason="root writes everywhere, and there is no setpriv to take that away",
)
def test_read_only_folders_are_read_and_told_where_they_are_to_be_written(small_project, tmp_path):
    """The project's own may be read only; the result's may not, and stays as it was."""
    texels = ["compute_svbrdf_texels", "texture_size=32"]
    out, source = tmp_path / "out", small_project.parent
    before = digests(source)
    for folder in (source / "frames", source):
        folder.chmod(0o555)
    done = ordinary(["apply", small_project, *texels, "-o", out])
    assert done.returncode == 0, done.stderr
    done = ordinary(["apply", small_project, *texels])  # in place
    assert done.returncode == 1
    assert re.search(
        r"^Error: \S*small\.\S+: Permission denied; see to its .*\n\Z", done.stderr, re.M
    )
    assert digests(source) == before

    result, results = digests(out), [p for p in (out, *out.rglob("*")) if p.is_dir()]
    for folder in results:
        folder.chmod(0o555)
    done = ordinary(["apply", out / "small.mlp", texels[0], "texture_size=64"])
    assert done.returncode == 1
    assert re.search(
        r"^Error: \S*small\.\S+: Permission denied; see to its .*\n\Z", done.stderr, re.M
    )
    assert digests(out) == result
    for folder in (source, source / "frames", *results):
        folder.chmod(0o755)


def digests(folder):
    files = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != ".lock")
    return {path: path.read_bytes() for path in files}


def test_the_command_is_installed_and_starts_at_once():
    code = (
        "import sys; from meshlab_svbrdf import cli\n"
        "from typer.testing import CliRunner\n"
        "result = CliRunner().invoke(cli.app, ['--help'])\n"
        "assert result.exit_code == 0 and 'run' in result.stdout\n"
        "assert not {'pymeshlab', 'numba', 'numpy', 'cv2'} & sys.modules.keys()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
