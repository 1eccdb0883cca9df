"""Every stage's single precision against double: its own kernels on double inputs, or NumPy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from meshlab_svbrdf.geometry.adjacency import neighbours
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.texels import rasterise_texels
from meshlab_svbrdf.geometry.visibility import Rays, vertex_visibility
from meshlab_svbrdf.power import ln
from meshlab_svbrdf.reflectance.albedo import divide_light, lamp_irradiance
from meshlab_svbrdf.reflectance.diffuse import specular_weight
from meshlab_svbrdf.reflectance.diffuse_refit import refitting
from meshlab_svbrdf.reflectance.elimination import ALPHAS, eliminate
from meshlab_svbrdf.reflectance.environment import environment_map
from meshlab_svbrdf.reflectance.fit_samples import FitSamples
from meshlab_svbrdf.reflectance.lights import lights_by_peaks
from meshlab_svbrdf.reflectance.materials import segment
from meshlab_svbrdf.reflectance.microfacet import phong_gloss
from meshlab_svbrdf.reflectance.specular import texel_specular
from meshlab_svbrdf.reflectance.threshold import luminance_threshold
from meshlab_svbrdf.samples.capture import FrameSampler
from meshlab_svbrdf.samples.luminance import REC709, decode, encode
from meshlab_svbrdf.samples.observations import Observations
from tests.analytic import angle, ball, film, lamp, lobes, look_at, orbit, plane, sphere, unit

from .checks import Case
from .lamps import RAYS, _map
from .precision import _texels
from .statistics import SINGLE, _diffuse, _threshold

T, F = 400, 120
LAMPS = [lamp([0.3, 0.5, 0.8], 1.2, spread=0.1), lamp([-0.8, 0.3, 0.3], 1 / 1.2, spread=0.1)]
RHO, ALPHA = 30.0, 25.0


def cases(folder: Path) -> Iterator[Case]:
    yield "texels", "position, of the radius", 1e-6, partial(_texels, 1.0, 1e6)
    yield "visibility", "share of V that changes by 10⁻⁵", 0.01, _visibility
    yield "samples", "codes, beyond their rounding", 0.05, _samples
    yield "luminance threshold", "t, of 100", SINGLE, partial(_threshold, folder, "noise", 1_000)
    yield "environment map", "of its largest", 1e-5, partial(_environment, folder)
    yield "diffuse colour, s of a sample", "s", 1e-5, _weight
    yield (
        "diffuse colour, without light",
        "D, of 100",
        SINGLE,
        partial(_diffuse, folder, "noise", 1_000),
    )
    yield "light sources", "degrees", 1e-6, _lights
    yield "specular of texels", "ln α, ln ρs", 1e-4, partial(_peaks, folder)
    yield "materials", "share of the texels", 1e-3, _materials
    yield "specular of materials, sums", "of the largest", 1e-5, _sums
    yield "diffuse colour, gloss taken off", "D, of 100", 1e-4, partial(_refit, folder)
    yield "albedo", "relative", 1e-6, _albedo


def _visibility() -> float:
    """Two balls that hide one another, and the same a million metres away."""
    one = sphere(12)
    both = Mesh(
        np.concatenate([one.vertices, one.vertices + np.array([2.2, 0, 0])]),
        np.concatenate([one.faces, one.faces + len(one.vertices)]),
        np.concatenate([one.normals, one.normals]),
    )
    far = replace(both, vertices=both.vertices + 1e6)
    difference = vertex_visibility(far, 256) - vertex_visibility(both, 256)
    return float(np.mean(np.abs(difference) > 1e-5))


def _samples() -> float:
    """A frame of noise on a wall, against projection and interpolation in double precision."""
    camera = look_at([0.8, 0.5, 3], [0.1, 0, 0], width=200, height=160, fx=230.0, fy=210.0)
    mesh = plane(2.0)
    texels = rasterise_texels(mesh, ((160, 160),))
    image = np.random.default_rng(4).integers(0, 256, (160, 200, 3), np.uint8)
    found = FrameSampler(mesh, texels, 3.0).sample(camera, image)
    x, y, _ = camera.project(texels.position[found.texel].astype(float) + texels.center).T
    col, row = x.astype(int), y.astype(int)
    a, b = (x - col)[:, None], (y - row)[:, None]
    linear = decode(image / 255)
    exact = (1 - b) * ((1 - a) * linear[row, col] + a * linear[row, col + 1]) + b * (
        (1 - a) * linear[row + 1, col] + a * linear[row + 1, col + 1]
    )
    return float(np.abs(found.rgb - 255 * encode(exact)).max()) - 0.5


def _doubled(observations: Observations) -> Observations:
    """The same in double precision: kernels are compiled for it."""
    view = observations.view
    wide = {
        name: getattr(view, name).astype(float)
        for name in ("position", "normal", "barycentric", "eyes", "scale", "linear")
    }
    return replace(observations, view=view._replace(**wide))


def _filmed(folder: Path):
    diffuse = np.random.default_rng(0).uniform(4, 20, (T, 3))
    return film(
        folder, ball(T), orbit(F, turns=4, climb=120), LAMPS, np.zeros(T, int), [RHO], [ALPHA],
        diffuse,
    )  # fmt: skip


def _environment(folder: Path) -> float:
    scene = _filmed(folder / "environment").observations
    statistics = luminance_threshold(scene)
    single, double = (
        environment_map(o, statistics, height=32).radiance for o in (scene, _doubled(scene))
    )
    return float(np.abs(single - double).max() / double.max())


def _weight() -> float:
    """s = b^(w²)/w of samples, thresholds and light of all sizes."""
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(2_000):
        low, t, y = np.sort(rng.uniform(0, 100, 3)).astype(np.float32)
        b = np.float32(rng.uniform(0.01, 1))
        w = np.clip((float(t) - float(low)) / (float(y) - float(low)), 0.25, 4)
        exact = min(float(b) ** (w * w) / w, 1.0)
        worst = max(worst, abs(float(specular_weight(y, ln(b), t, low)) - exact))
    return worst


def _lights() -> float:
    places = [light.direction for light in LAMPS]
    radiance = sum(50 * np.exp(-0.5 * (angle(RAYS, p) / 4) ** 2) for p in places)
    double, single = (lights_by_peaks(_map(m)) for m in (radiance, radiance.astype(np.float32)))
    return max(angle(a.direction, b.direction) for a, b in zip(double, single, strict=True))


def _peaks(folder: Path) -> float:
    """Of texels whose two samples are the same both ways, as all but ties are."""
    scene = _filmed(folder / "peaks")
    diffuse = scene.diffuse @ REC709
    single, double = (
        texel_specular(o, diffuse, LAMPS)
        for o in (scene.observations, _doubled(scene.observations))
    )
    known = np.isfinite(double.alpha)
    if (known != np.isfinite(single.alpha)).mean() > 0.01 or not known.any():
        return np.inf
    known &= np.isfinite(single.alpha)
    ratios = [single.alpha / double.alpha, single.rho_s / double.rho_s]
    return float(max(np.quantile(np.abs(np.log(r[known])), 0.99) for r in ratios))


def _materials() -> float:
    """Two colours under uneven light, from D in single and in double precision."""
    mesh = sphere(24)
    texels = rasterise_texels(mesh, ((64, 64),))
    adjacency = neighbours(texels.position, texels.normal)
    side = texels.position[:, 0] > 0.1
    shade = 0.3 + 0.7 * np.maximum(texels.normal.astype(float) @ unit([1, 2, 3]), 0)
    colors = np.where(side[:, None], [40.0, 20, 10], [10.0, 20, 40]) * shade[:, None]
    double, single = (segment(c, adjacency) for c in (colors, colors.astype(np.float32)))
    return float(np.mean(double != single))


def _sums() -> float:
    """N, Q and T of the elimination."""
    texels, count = 40, 50
    rng = np.random.default_rng(6)
    n = texels * count
    owner = np.repeat(np.arange(texels), count)
    rays = unit([0, 0, 1] + 0.05 * rng.normal(size=(texels, 1, 3))).astype(np.float32)
    mirror = unit([0, 0, 1] + rng.exponential(0.2, (n, 1)) * unit(rng.normal(size=(n, 3))))
    mirror, gains = mirror.astype(np.float32), np.ones((texels, 1), np.float32)
    cos = np.clip(np.einsum("nc,nc->n", rays[owner, 0].astype(float), mirror.astype(float)), 0, 1)
    y = (rng.uniform(0, 60, texels)[owner] + RHO * cos**ALPHA).astype(np.float32)
    samples = FitSamples(
        np.arange(texels), np.zeros(texels, np.int32), np.arange(texels + 1) * count, y,
        np.zeros((n, 3), np.float32), np.ones(n, np.float32), np.zeros(n, bool), mirror,
        np.zeros((n, 4), np.float32),
    )  # fmt: skip
    found = eliminate(
        samples, np.ones(n, np.float32), rays, gains, 1, lambda work: [work(0, texels)]
    )[0]

    def centred(v):
        v = v.astype(float).reshape(texels, count)
        return v - v.mean(1, keepdims=True)

    exact = [
        [
            (centred(cos**a) * centred(y)).sum(),
            (centred(cos**a) ** 2).sum(),
            (centred(y) ** 2).sum(),
        ]
        for a in ALPHAS
    ]
    exact = np.array(exact).T
    return float((np.abs(found - exact).max(1) / np.abs(exact).max(1)).max())


def _refit(folder: Path) -> float:
    """D of known lobes by two steps of Huber's weights, in double precision from the same codes."""
    scene = _filmed(folder / "refit")
    o = scene.observations
    start = scene.diffuse.astype(np.float32)
    gloss = phong_gloss([RHO], [ALPHA])
    (found,) = o.store.rows(
        refitting(o, start, np.zeros(T, np.int32), gloss, np.ones((1, 3)), LAMPS)
    )
    shine = RHO * lobes(o.texels, scene.cameras, LAMPS, ALPHA)
    worst = 0.0
    for block in o.store.blocks():
        for i in range(block.stop - block.first):
            t, own = block.first + i, slice(block.offsets[i], block.offsets[i + 1])
            rgb = 100 * decode(block.value[own, :3] / 255)
            q, s = (block.value[own, 3] & 127) / 127, shine[t, block.frame[own]]
            bound = np.where((block.value[own, 3] >= 128) | (rgb @ REC709 > 98), 0.0, -np.inf)
            e, d = rgb @ REC709 - s, float(start[t] @ REC709)
            h = max(0.3, 1.68 * float(np.median(np.abs(e - d)))) + 0.2 * s
            for _ in range(2):
                w = q / (1 + (s / 10) ** 2) * h / np.maximum(h, np.abs(e - d)) * (e - d > bound)
                d = (w * e).sum() / w.sum()
            worst = max(worst, np.abs((w @ (rgb - s[:, None])) / w.sum() - found[t]).max())
    return float(worst)


def _albedo() -> float:
    mesh = sphere(24)
    texels = rasterise_texels(mesh, ((64, 64),))
    truth = np.random.default_rng(7).uniform(0.05, 0.9, (len(texels), 3))
    light = lamp_irradiance(texels, texels.normal.astype(float), Rays(mesh), LAMPS)
    ambient, openness = np.full(3, 0.1), np.ones(len(texels))
    shaded = (truth * (light[:, None] + ambient)).astype(np.float32)
    found = divide_light(shaded, light.astype(np.float32), openness, ambient)
    return float(np.nanmax(np.abs(found / truth - 1)))
