"""What the code may not do on any system, and what it declares to need."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FILES = sorted([*(ROOT / "meshlab_svbrdf").rglob("*.py"), *(ROOT / "filters").glob("*.py")])
SHELL = {
    "os.system", "os.popen", "os.execv", "os.execvp", "os.spawnv", "os.spawnvp", "eval", "exec",
    "pickle.load", "pickle.loads", "marshal.loads", "subprocess.getoutput",
    "subprocess.getstatusoutput",
}  # fmt: skip
# What pathlib has no equal for: `..` taken out without following links, and many files asked after
PATHS = {"os.path.normpath", "os.path.relpath", "os.path.abspath", "os.path.isfile"}
UNSAFE_XML = {"xml.dom", "xml.sax", "lxml"}  # one reader, which refuses entities
LONE_FORKS = {"os.fork", "os.forkpty", "pty"}  # of POSIX alone


def calls(tree: ast.AST):
    """Every call, with its dotted name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


@pytest.fixture(scope="module", params=FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def tree(request) -> ast.AST:
    return ast.parse(request.param.read_text(encoding="utf-8"))


def test_no_shell_no_pickle_and_pathlib_alone(tree):
    for name, call in calls(tree):
        given = {word.arg: ast.unparse(word.value) for word in call.keywords}
        assert name not in SHELL | LONE_FORKS
        assert given.get("shell", "False") == "False", f"line {call.lineno}: a shell"
        assert given.get("allow_pickle", "False") == "False", f"line {call.lineno}: pickle"
        if name.startswith("os.path."):
            assert name in PATHS, f"line {call.lineno}: pathlib does {name}"
    for node in ast.walk(tree):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        assert not any(name.startswith(tuple(UNSAFE_XML)) for name in names)


def test_text_files_are_utf8_whatever_the_system_prefers(tree):
    """Windows' own encoding loses labels; what is ASCII by construction may leave it out."""
    for name, call in calls(tree):
        if name.endswith(".write_text") and len(call.args) == 1:
            given = {word.arg for word in call.keywords}
            plain = isinstance(call.args[0], ast.Constant) and call.args[0].value.isascii()
            assert plain or given or "json.dumps" in ast.unparse(call.args[0]), call.lineno


def test_every_dependency_has_a_lower_bound_and_none_an_upper_one():
    for line in PROJECT["dependencies"]:
        assert re.fullmatch(r"[A-Za-z0-9-]+>=[0-9.]+(post[0-9]+)?", line), line


def test_only_batches_benchmarks_and_the_compiling_start_processes():
    starting = {
        path.relative_to(ROOT).as_posix()
        for path in FILES
        if re.search(r"^\s*(import|from) (subprocess|multiprocessing)", path.read_text(), re.M)
    }
    assert starting == {
        f"meshlab_svbrdf/{name}.py"
        for name in ("batch", "bench/child", "bench/machine", "bench/first_run", "kernels")
    }
