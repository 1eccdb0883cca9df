"""The method's guards, and that a test fails without each: the guard is taken out, the test run.

A guard is a piece of source and what stands there without it. The tree is copied, and next to
nothing is compiled: the functions run as Python.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..ledger import ROOT

COPIED = ("meshlab_svbrdf", "tests", "sample_projects/__init__.py", "sample_projects/procedural",
          "sample_projects/make_totem.py", "pyproject.toml")  # fmt: skip


# Divides numbers of Python's by zero, which compiled is no error
COMPILED = ("tests/reflectance/test_diffuse.py::test_weight_of_the_darkest_sample_is_nothing",)


@dataclass(frozen=True)
class Guard:
    """what : it guards; file, old, new : the source with and without it; test : fails without"""

    what: str
    file: str
    old: str
    new: str
    test: str


def _guards(file: str, test_file: str, *rows: tuple[str, str, str, str]) -> list[Guard]:
    return [
        Guard(what, f"meshlab_svbrdf/{file}", old, new, f"tests/{test_file}::{test}")
        for what, old, new, test in rows
    ]


GUARDS: list[Guard] = [
    *_guards(
        "reflectance/threshold.py", "reflectance/test_threshold.py",
        ("fewer than 8 samples: unobserved", "if n < least:", "if n < 1:",
         "test_fewer_samples_than_asked_for_are_unobserved"),
    ),
    *_guards(
        "reflectance/environment.py", "reflectance/test_environment.py",
        ("a pixel without samples is 0", ", where=divisor > 0)", ")", "test_is_brute_forces"),
        ("scale by P99.9, not the largest pixel", "np.quantile(seen, 0.999)", "seen.max()",
         "test_scale_is_taken_over_the_pixels_that_have_samples"),
    ),
    *_guards(
        "reflectance/diffuse.py", "reflectance/test_diffuse.py",
        ("Y = min: s = 0", "(y > minimum) & ", "", "test_weight_of_the_darkest_sample_is_nothing"),
        ("t − min < 10⁻⁶: w = 1", "w = w if threshold - minimum >= 1e-6 else one", "w = w",
         "test_weight_of_a_constant_texel_is_b"),
        ("w in [¼, 4]", "w = min(max(w, np.float32(0.25)), np.float32(4))", "w = w",
         "test_w_is_clamped"),
        ("s in [0, 1]", "min(exp(exponent) / w, one)", "exp(exponent) / w",
         "test_weight_is_clamped_to_one"),
        ("no light in the cone: s = 0", " & (exponent > DARK / 16)", "",
         "test_weight_without_light_in_the_cone_is_nothing"),
    ),
    *_guards(
        "reflectance/lights.py", "reflectance/test_lights.py",
        ("a blob of one pixel is not singular", "* pixel**2 / 12", "* 0.0",
         "test_blob_of_one_pixel_is_not_singular"),
        ("only l·r > .1 is projected", "near = cos > 0.1", "near = cos > -2",
         "test_blob_projects_only_what_is_before_it"),
        ("blobs below 5 % are dropped", " if light.energy >= minimum_energy * lights[0].energy",
         "", "test_lights_below_a_share_of_the_strongest_are_dropped"),
        ("level of P99.95, not the largest pixel", "np.quantile(radiance[seen], 0.9995)",
         "radiance[seen].max()", "test_one_noisy_pixel_sets_no_scale"),
        ("directions that cancel are no light",
         "np.linalg.norm(e @ r) > LEAST_RESULTANT * e.sum()", "True",
         "test_light_from_everywhere_has_no_made_up_direction"),
        ("only pixels that have samples", "_connect(seen & (radiance > level * top))",
         "_connect(radiance > level * top)", "test_what_no_sample_mirrors_is_no_light"),
    ),
    *_guards(
        "reflectance/specular.py", "reflectance/test_specular.py",
        ("E_max > 3", "excess_max > EXCESS_MAX and ", "", "test_guards"),
        ("E_min > .5", "excess_min > EXCESS_MIN and ", "", "test_guards"),
        ("E_max / E_min > 1.3", " and excess_max / excess_min > CONTRAST", "", "test_guards"),
        ("1 < α < 2000", "if not (SHININESS[0] < alpha < SHININESS[1]):", "if alpha != alpha:",
         "test_guards"),
        ("ρs < 1000", "if not rho < RHO_MOST:", "if rho != rho:", "test_guards"),
        ("d_max < 2.5", "-1, FARTHEST * FARTHEST", "-1, np.inf",
         "test_peak_too_far_from_every_light_belongs_to_none"),
        ("clipped samples are no peak",
         "if excess > high and not is_clipped(block, view, run[k]):", "if excess > high:",
         "test_clipped_samples_are_dropped"),
    ),
    *_guards(
        "reflectance/density.py", "reflectance/test_density.py",
        ("1 to 99 %", "[0.01, 0.99]", "[0.0, 1.0]",
         "test_tails_beyond_a_percent_set_no_bandwidth"),
        ("too few texels: unobserved", "if len(rho_s) < MINIMUM_TEXELS:", "if len(rho_s) < 1:",
         "test_too_few_texels_tell_nothing"),
    ),
    *_guards(
        "reflectance/elimination.py", "reflectance/test_elimination.py",
        ("the first sample is taken off before summing", "d[j] = y[j] - origin", "d[j] = y[j]",
         "test_offsets_of_ten_million_cost_nothing"),
        ("a minimum at an end of the range says so", "at_end = best in (0, len(rss) - 1)",
         "at_end = False", "test_a_lobe_at_an_end_of_the_grid_says_so"),
    ),
    *_guards(
        "reflectance/evidence.py", "reflectance/test_evidence.py",
        ("an end of the range: unobserved", "    if at_end:", "    if False:",
         "test_each_objection_has_its_reason"),
        ("z > 3", "if not evidence.z > Z_LEAST:", "if False:",
         "test_each_objection_has_its_reason"),
        ("interval of ln α < 1.5", "if not width < WIDTH_MOST:", "if False:",
         "test_each_objection_has_its_reason"),
        ("explained variance > .3", "if not evidence.explained > EXPLAINED_LEAST:", "if False:",
         "test_each_objection_has_its_reason"),
    ),
    *_guards(
        "reflectance/light_refinement.py", "reflectance/test_light_refinement.py",
        ("steps and κ are bounded", "np.clip(light.curvature + np.clip(kappa[0], -3 * step, "
         "3 * step), 0, 0.5)", "light.curvature + kappa[0]",
         "test_steps_and_distances_are_bounded"),
    ),
    *_guards(
        "geometry/visibility.py", "geometry/test_visibility.py",
        ("harmonics' ringing is cut off", "np.clip((visibility - 0.25) * 2, 0, 1)",
         "(visibility - 0.25) * 2", "test_remap"),
    ),
]  # fmt: skip


def try_guards(folder: Path, guards: list[Guard] = GUARDS) -> list[dict[str, Any]]:
    """A row for each guard: whether its test passes with it, and fails without it."""
    for name in COPIED:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.is_file():
            shutil.copy2(source, target)
    passes: dict[str, bool] = {}
    rows = []
    for guard in guards:
        if guard.test not in passes:
            passes[guard.test] = _passes(folder, guard.test)
        path = folder / guard.file
        whole = path.read_text(encoding="utf-8")
        path.write_text(without(guard, whole), encoding="utf-8")
        needed = not _passes(folder, guard.test)
        path.write_text(whole, encoding="utf-8")
        rows.append({"guard": guard.what, "test": guard.test,
                     "broke": "" if passes[guard.test] and needed else
                     "passes without it" if passes[guard.test] else "fails with it"})  # fmt: skip
    return rows


def without(guard: Guard, source: str) -> str:
    """The source without the guard; ValueError where it is not there exactly once."""
    if source.count(guard.old) != 1:
        raise ValueError(f"{guard.file}: {guard.old!r} is there {source.count(guard.old)} times")
    return source.replace(guard.old, guard.new)


def _passes(folder: Path, test: str) -> bool:
    # As Python, divisions by zero warn that compiled ones do not
    quiet = ["-p", "no:cacheprovider", "-W", "ignore::RuntimeWarning"]
    command = [sys.executable, "-m", "pytest", "-x", "-q", *quiet, test]
    own = {"PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(folder / "kernels")}
    if test not in COMPILED:
        own["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(command, cwd=folder, env=os.environ | own, capture_output=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:])
    return done.returncode == 0
