"""The list of kernels, and compiling them ahead in a second process."""

import inspect
import os
import subprocess
import sys
import time
from contextlib import nullcontext

import pytest
from numba import types

from meshlab_svbrdf import jit, kernels
from meshlab_svbrdf.kernel_list import _argument, _type, listed
from meshlab_svbrdf.kernels import compiling
from meshlab_svbrdf.samples.store import Block

AHEAD = [sys.executable, "-m", "meshlab_svbrdf.compile_ahead"]


@pytest.mark.parametrize(
    "each",
    [
        types.int64,
        types.boolean,
        types.none,
        types.Array(types.float32, 2, "C"),
        types.Array(types.uint8, 1, "A", readonly=True),
        types.UniTuple(types.float64, 4),
        types.BaseTuple.from_types(
            (types.int64, types.int64, *[types.Array(types.int64, 1, "C")] * 3), Block
        ),
    ],
)
def test_types_of_arguments_come_back(each):
    assert _type(_argument(each)) == each


def test_the_list_is_of_this_code():
    """Names, numbers of arguments and fields of tuples. If not:
    python -m meshlab_svbrdf.bench.first_run"""
    for kernel, arguments in listed():
        inspect.signature(kernel.py_func).bind(*arguments)
        for each in arguments:
            if isinstance(each, types.BaseNamedTuple):
                assert len(each.types) == len(each.instance_class._fields)
    assert len(listed()) > 30


def test_the_second_process_ends_with_the_first(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen(AHEAD, env=environment, stdin=subprocess.PIPE) as second:
        deadline = time.monotonic() + 300
        while not list(tmp_path.rglob("*.nbi")):
            assert time.monotonic() < deadline
            assert second.poll() is None
            time.sleep(0.1)
        assert second.poll() is None
    assert second.returncode == 0
    names = {path.suffix for path in tmp_path.rglob("*") if path.is_file()}
    assert names == {".nbi", ".nbc"}  # nothing half written


def test_what_another_process_compiled_is_taken(tmp_path):
    """Its entries lead to their own data, beside those of this process."""
    code = (
        "import numpy as np\n"
        "from numba import njit\n"
        "from numba.core.caching import IndexDataCacheFile\n"
        "from meshlab_svbrdf import compile_ahead\n"
        "import one\n"
        "one.twice(1)\n"
        "IndexDataCacheFile.save = compile_ahead._save\n"
        "one.twice(1.5)\n"
    )
    (tmp_path / "one.py").write_text(
        "from meshlab_svbrdf.jit import kernel\n@kernel\ndef twice(x):\n    return x * 2\n"
    )
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "kept"),
        "PYTHONPATH": str(tmp_path),
    }
    read = "import one\nprint(one.twice(2), one.twice(2.5), one.twice.stats.cache_misses)"
    for script in (code, read):
        told = subprocess.run([sys.executable, "-c", script], env=environment, check=True,
                              capture_output=True, text=True)  # fmt: skip
    assert told.stdout.split() == ["4", "5.0", "Counter()"]
    assert len(list((tmp_path / "kept").rglob("*.nbc"))) == 2


def test_an_inner_kernel_is_called_by_kernels_only():
    """From Python it would crash."""

    @jit.inner
    def half(x):
        return x / 2

    @jit.kernel
    def quarter(x):
        return half(x) / 2

    assert quarter(2.0) == 0.5
    with pytest.raises(TypeError, match="half is called by kernels only"):
        half(2.0)


@pytest.mark.parametrize(("cores", "helped"), [(1, 0), (2, 1)])
def test_a_second_process_helps_where_there_is_a_core_for_it(monkeypatch, cores, helped):
    said, started = [], []
    monkeypatch.setattr(kernels, "compiled", lambda: False)
    monkeypatch.setattr(kernels, "thread_count", lambda: cores)
    monkeypatch.setattr(kernels, "_second", lambda: started.append(1) or nullcontext())
    with compiling(said.append):
        assert len(started) == helped
    assert ["once" in line for line in said] == [True]


def test_nothing_is_said_where_all_is_compiled():
    said = []
    with compiling(said.append):
        pass
    assert not said
