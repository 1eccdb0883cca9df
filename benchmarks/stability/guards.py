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


COMPILED = (
    # Divides numbers of Python's by zero, which compiled is no error
    "tests/reflectance/test_diffuse.py::test_weight_of_the_darkest_sample_is_nothing",
    # Numbers of Python's become single beside single ones
    "tests/reflectance/test_threshold.py::test_sums_of_millions_lose_nothing",
    # Slow as Python
    "tests/samples/test_capture.py",
    "tests/reflectance/test_normal_refinement.py",
)


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
        "samples/capture.py", "samples/test_capture.py",
        ("what lies behind something is not seen", "(behind <= occlusion * w) & ", "",
         "test_a_screen_hides_its_shadow_and_nothing_else"),
        ("quality falls towards depth jumps",
         "_mark_jumps(inverse_depth, np.float32(q.jump * texels.radius), smooth)", "pass",
         "test_depth_jump_lowers_quality_around_it_in_proportion_to_the_image"),
        ("q_depth is at most 1", "near = min(reference_depth / z, one)",
         "near = reference_depth / z", "test_quality_on_a_wall_is_the_formula"),
        ("q < .1 is dropped", "np.float32(q.cut), kind(clipped)", "np.float32(0), kind(clipped)",
         "test_quality_on_a_wall_is_the_formula"),
        ("what a mask covers is not seen", " & (quality > zero)", "",
         "test_what_the_mask_covers_is_never_seen"),
        ("clipped is any tap of any channel",
         "brightest = max(brightest, max(max(p00, p01), max(p10, p11)))",
         "brightest = max(brightest, p00)", "test_clipped_is_any_tap_of_any_channel"),
    ),
    *_guards(
        "samples/gains.py", "samples/test_gains.py",
        ("frames that share little have no gain", ">= LEAST_SHARED", ">= 1",
         "test_a_frame_that_shares_little_has_no_gain"),
    ),
    *_guards(
        "geometry/texels.py", "geometry/test_texels.py",
        ("coordinates are about the centre before they are single",
         "lambda some: (some - center).astype(np.float32)",
         "lambda some: some.astype(np.float32) - center.astype(np.float32)",
         "test_map_coordinates_cost_nothing"),
    ),
    *_guards(
        "reflectance/threshold.py", "reflectance/test_threshold.py",
        ("fewer than 8 samples: unobserved", "if n < least:", "if n < 1:",
         "test_fewer_samples_than_asked_for_are_unobserved"),
        ("only samples of q ≥ .1", "    if kept == len(quality):\n        return kept\n",
         "    return len(quality)\n", "test_only_samples_of_the_least_quality_count"),
        ("sums are double", "r, g, b, total = 0.0, 0.0, 0.0, 0.0",
         "r = g = b = total = np.float32(0)", "test_sums_of_millions_lose_nothing"),
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
        ("a peak ends with its sequence", "sequence[f] != sequence[g] or ", "",
         "test_peak_ends_with_its_sequence"),
        ("a peak ends at a frame that was left out", " or skipped", "",
         "test_peak_ends_at_a_frame_that_was_left_out"),
        ("a peak ends after a gap of two", " or g - f > GAP + 1", "",
         "test_peak_ends_after_a_gap_of_two"),
    ),
    *_guards(
        "reflectance/rows.py", "reflectance/test_specular.py",
        ("Y > 98 is clipped", "quality >= 128 or np.float32(100) * relative_luminance(r, g, b) > "
         "SATURATED", "quality >= 128", "test_luminance_above_98_is_clipped"),
    ),
    *_guards(
        "reflectance/density.py", "reflectance/test_density.py",
        ("1 to 99 %", "[0.01, 0.99]", "[0.0, 1.0]",
         "test_tails_beyond_a_percent_set_no_bandwidth"),
        ("too few texels: unobserved", "if len(rho_s) < MINIMUM_TEXELS:", "if len(rho_s) < 1:",
         "test_too_few_texels_tell_nothing"),
        ("without quartiles σ alone", "(min(sigma, iqr) if iqr > 0 else sigma)",
         "min(sigma, iqr)", "test_bandwidth_without_quartiles_is_sigmas_alone"),
    ),
    *_guards(
        "reflectance/phong.py", "reflectance/test_phong.py",
        ("no light from below the horizon", " if above > 0 else 0.0", "",
         "test_lights_below_the_horizon_are_out_whatever_the_harmonics_say"),
    ),
    *_guards(
        "reflectance/fit_samples.py", "reflectance/test_fit_samples.py",
        ("only flat texels", "most = max(limits[m], flattest)", "most = np.inf",
         "test_where_nothing_is_flat_the_flattest_twentieth_is_taken"),
        ("else the flattest 5 %", "most = max(limits[m], flattest)", "most = limits[m]",
         "test_where_nothing_is_flat_the_flattest_twentieth_is_taken"),
        ("clipped is judged before dividing by exposure",
         "view.linear[red], view.linear[green], view.linear[blue])",
         "*(np.array(color(block, view, j)) / 100))",
         "test_clipping_is_judged_before_the_exposure_is_divided_out"),
    ),
    *_guards(
        "reflectance/fit_state.py", "reflectance/test_joint.py",
        ("a clipped sample is a lower bound", "if clipped[j] and not (use_clipped and e > 0):",
         "if False:", "test_a_clipped_sample_counts_only_where_it_was_predicted_too_dark"),
        ("peaks are not weighed down", "h = h0 + 0.2 * specular[j]", "h = h0",
         "test_outliers_are_weighed_down_but_peaks_are_not"),
        ("the scale of outliers has a floor", "scale[m] = max(0.3, 1.68 * float(np.median(e)))",
         "scale[m] = 1.68 * float(np.median(e))",
         "test_scale_of_outliers_is_robust_and_has_a_floor"),
    ),
    *_guards(
        "reflectance/joint.py", "reflectance/test_joint.py",
        ("κ < 2 σ: far", "max(FARTHEST, 2 * error[k])", "FARTHEST",
         "test_a_light_is_far_where_its_distance_does_not_show"),
        ("κ < .01: far", "max(FARTHEST, 2 * error[k])", "2 * error[k]",
         "test_a_light_is_far_where_its_distance_does_not_show"),
        ("a light of next to no gain is none", "if light.gain >= WEAKEST * strongest", "",
         "test_lights_that_settle_at_next_to_nothing_are_dropped"),
    ),
    *_guards(
        "reflectance/elimination.py", "reflectance/test_elimination.py",
        ("the first sample is taken off before summing", "d[j] = y[j] - origin", "d[j] = y[j]",
         "test_offsets_of_ten_million_cost_nothing"),
        ("no division by lobes that no sample shows",
         ", where=q > 1e-12 * max(float(q.max()), 1e-300))", ")",
         "test_no_evidence_at_all_is_an_end_of_the_range"),
        ("ρ < 0 is no lobe", "rho = np.maximum(rho, 0)", "rho = rho",
         "test_samples_that_darken_towards_the_light_have_no_gloss"),
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
        ("c_m is grey unless it is certain",
         "(evidence.color_error <= COLOR_ERROR_MOST).all() and ", "",
         "test_highlights_are_white_unless_the_samples_clearly_say_otherwise"),
    ),
    *_guards(
        "reflectance/light_refinement.py", "reflectance/test_light_refinement.py",
        ("steps and κ are bounded", "np.clip(light.curvature + np.clip(kappa[0], -3 * step, "
         "3 * step), 0, 0.5)", "light.curvature + kappa[0]",
         "test_steps_and_distances_are_bounded"),
        ("directions move by a step at most",
         "x * min(1.0, step / max(float(np.linalg.norm(x)), 1e-12)) for", "x for",
         "test_steps_and_distances_are_bounded"),
        ("a light that no sample shows stays", "    free &= np.diag(matrix) > 0\n", "",
         "test_a_light_whose_highlights_no_sample_sees_stays"),
        ("gains have geometric mean 1", "gain=light.gain / mean)", "gain=light.gain)",
         "test_gains_have_geometric_mean_one"),
    ),
    *_guards(
        "reflectance/normal_steps.py", "reflectance/test_normal_refinement.py",
        ("normals stay within 2 σ", "if length > 2.0 * sigma:", "if False:",
         "test_no_correction_exceeds_two_sigma"),
    ),
    *_guards(
        "reflectance/diffuse_refit.py", "reflectance/test_diffuse.py",
        ("D: a clipped sample is a lower bound", "a if away > bound[j] else np.float32(0)", "a",
         "test_refit_takes_clipped_samples_for_lower_bounds"),
    ),
    *_guards(
        "reflectance/albedo.py", "reflectance/test_albedo.py",
        ("too little light: no albedo", ", out=np.full(light.shape, np.nan), where=enough)", ")",
         "test_dividing_is_the_inverse_of_shading"),
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
    if not test.startswith(COMPILED):
        own["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(command, cwd=folder, env=os.environ | own, capture_output=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:])
    return done.returncode == 0
