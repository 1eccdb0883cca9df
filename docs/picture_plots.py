"""The plots among the documentation's pictures: samples over time, bells, profiles."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from picture_kit import BLUE, DIM, GREEN, INK, ORANGE, RED, TRUTH, Scene

from meshlab_svbrdf.document.images import read_image
from meshlab_svbrdf.reflectance.density import highest_bell
from meshlab_svbrdf.reflectance.directions import look_up
from meshlab_svbrdf.reflectance.elimination import ALPHAS, eliminate, profile
from meshlab_svbrdf.reflectance.fit_samples import choose_texels, collect
from meshlab_svbrdf.reflectance.lights import Light, tangents
from meshlab_svbrdf.reflectance.phong import lamps, light_texels
from meshlab_svbrdf.samples.luminance import luminance


@dataclass
class History:
    """One texel's samples: places in time (frames, one sequence after the other), luminance."""

    time: np.ndarray
    luminance: np.ndarray
    clipped: np.ndarray
    mirror: np.ndarray


def history(scene: Scene, texel: int) -> History:
    found = collect(scene.observations, np.array([texel]), np.array([0]))
    block = scene.observations.store.read(texel, texel + 1)
    return History(block.frame, found.luminance, found.clipped, found.mirror)


def good_texel(scene: Scene) -> int:
    """A texel of the glaze with a high peak that its neighbourhood confirms, seen throughout."""
    document, t = scene.document, scene.texels
    alpha, rho_s = document.attribute("alpha"), document.attribute("rho_s")
    counts, peak = document.attribute("frames"), document.attribute("light_distance")
    ids = read_image(TRUTH / "material_id.png")
    step = t.sizes[0][0] // len(ids)
    glaze = ids[t.row // step, t.col // step] == 1
    good = glaze & (counts > 100) & (peak < 0.5) & (abs(np.log(alpha / 60)) < 0.1)
    good &= abs(np.log(rho_s / 0.58)) < 0.1
    return int(np.flatnonzero(good)[np.count_nonzero(good) // 2])


def texel_history(scene: Scene, axis) -> None:
    """Luminance over the frames, with mean, threshold and diffuse luminance."""
    document, texel = scene.document, good_texel(scene)
    seen = history(scene, texel)
    t, mean = (float(document.attribute(n)[texel]) for n in ("threshold", "mean"))
    d = float(luminance(document.attribute("final_diffuse")[texel]))
    above = seen.luminance > t
    for edge in np.flatnonzero(np.diff(scene.observations.sequence)):
        axis.axvline(edge + 0.5, color=DIM, lw=0.8)
        where = axis.get_xaxis_transform()
        axis.text(edge + 3, 0.02, "second walk-around →", color=DIM, transform=where)
    axis.plot(seen.time[~above], seen.luminance[~above], ".", color=BLUE, label="diffuse samples")
    axis.plot(seen.time[above], seen.luminance[above], ".", color=ORANGE, label="above t: specular")
    if seen.clipped.any():
        axis.plot(
            seen.time[seen.clipped], seen.luminance[seen.clipped], "o", markerfacecolor="none",
            color=RED, label="clipped",
        )  # fmt: skip
    for value, name, color, style in (
        (t, "threshold t = μ + mean |Y − μ|", ORANGE, "--"), (mean, "mean μ", INK, ":"),
        (d, "diffuse colour D", GREEN, "-"),
    ):  # fmt: skip
        axis.axhline(value, color=color, ls=style, lw=1.2, label=f"{name} = {value:.1f}")
    axis.set(xlabel="frame", ylabel="luminance Y of one texel, 0 to 100", xlim=(0, 240))
    axis.set_ylim(0, min(100, 1.08 * float(seen.luminance.max())))
    axis.legend(ncols=2, fontsize=8)


def peak_in_time(scene: Scene, axis) -> None:
    """The excess over D in one peak, with the two samples that ρs and α are solved from."""
    document, texel = scene.document, good_texel(scene)
    seen = history(scene, texel)
    d = float(luminance(document.attribute("diffuse")[texel]))
    lamp = scene.lights_found[int(document.attribute("light")[texel])]
    angle = np.degrees(np.arccos(np.clip(seen.mirror @ lamp.direction, -1, 1)))
    excess = np.where(seen.clipped, -1, seen.luminance - d)
    top = int(np.argmax(np.where(angle < 25, excess, -1)))
    window = abs(seen.time - seen.time[top]) < 16
    run = window & (excess > 0)
    low = int(
        np.argmin(
            np.where(run & (np.arange(len(excess)) != top), abs(excess - excess[top] / 2), 9e9)
        )
    )
    axis.plot(seen.time[window], (seen.luminance - d)[window], ".-", color=BLUE, lw=0.8)
    axis.axhline(0, color=GREEN, lw=1.2)
    axis.text(seen.time[window][0], 0, " D", color=GREEN, va="bottom")
    for k, name in ((top, "c_max"), (low, "c_min")):
        axis.plot(seen.time[k], seen.luminance[k] - d, "o", color=ORANGE)
        axis.annotate(
            f"{name}, {angle[k]:.1f}° off the light", (seen.time[k], seen.luminance[k] - d),
            textcoords="offset points", xytext=(8, 2), color=ORANGE,
        )  # fmt: skip
    alpha, rho_s = (float(document.attribute(n)[texel]) for n in ("alpha", "rho_s"))
    axis.set(
        xlabel="frame", ylabel="luminance above D",
        title=f"one texel: α = {alpha:.0f}, ρs = {rho_s:.2f}",
    )  # fmt: skip
    axis.grid(alpha=0.4)


def light_shapes(scene: Scene, light: Light, half: float = 15.0):
    """The unclipped map in the tangent plane at a light: image, extent, direction → degrees."""
    frame = tangents(light.direction)
    x = np.tan(np.radians(np.linspace(-half, half, 240)))
    u, v = np.meshgrid(x, x)
    rays = light.direction + u[..., None] * frame[0] + v[..., None] * frame[1]
    rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3)
    image = look_up(scene.document.array("environment_radiance"), rays).reshape(u.shape)

    def place(direction: np.ndarray) -> np.ndarray:
        cos = direction @ light.direction
        flat = frame @ direction / cos if cos > 0.1 else np.full(2, 99.0)
        return np.degrees(np.arctan(flat))

    return image, (-half, half, -half, half), place


def true_reflectance(scene: Scene) -> list[tuple[str, float, float]]:
    """Name, ρs for a light of gain 1, and α of the true materials that have gloss."""
    gain = float(np.exp(np.mean([np.log(intensity) for *_, intensity in scene.truth])))
    found = json.loads((TRUTH / "materials.json").read_text())["materials"]
    return [(m["name"], m["rho_s"] * gain, m["alpha"]) for m in found if m["rho_s"] > 0]


def material_bells(scene: Scene, axis) -> None:
    """Density of ln ρs over the texels of the two largest glossy materials, and their bells."""
    document = scene.document
    labels = document.attribute("material")
    rho_s, alpha = document.attribute("rho_s"), document.attribute("alpha")
    glossy = [m for m in document.json("materials")["materials"] if m["observed"]][:2]
    for material, color in zip(glossy, (BLUE, ORANGE), strict=False):
        own = labels == material["id"]
        bell = highest_bell(rho_s[own], alpha[own])
        inside = (bell.x >= bell.low) & (bell.x <= bell.high)
        axis.plot(bell.x, bell.density, color=color)
        label = f"material {material['id']}: ρs = {bell.rho_s:.3f}, α = {bell.alpha:.0f}"
        axis.fill_between(
            bell.x[inside], bell.density[inside], color=color, alpha=0.35, label=label
        )
    for name, rho, _ in true_reflectance(scene):
        axis.axvline(rho, color=GREEN, ls="--")
        where = axis.get_xaxis_transform()
        axis.text(rho, 1.01, f"{name}, truth", color=GREEN, ha="center", transform=where)
    axis.set_xscale("log")
    axis.set(xlabel="ρs of the material's texels", ylabel="density of ln ρs", xlim=(0.05, 3))
    axis.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2], ["0.05", "0.1", "0.2", "0.5", "1", "2"])
    axis.legend()


def joint_profiles(scene: Scene, axis) -> None:
    """What every shininess leaves unexplained, for the three largest materials."""
    document, observations = scene.document, scene.observations
    labels = document.attribute("material").astype(np.int32)
    materials = document.json("materials")["materials"][:3]
    counts = observations.store.counts()
    wanted = np.where(labels < len(materials), labels, -1)
    flat = np.zeros(len(labels))
    chosen, _ = choose_texels(wanted, counts, flat, np.ones(len(materials)), 1_500_000)
    found = collect(observations, chosen, wanted[chosen])
    rays, gains = light_texels(
        observations.view, chosen, lamps(scene.lights, observations.texels.radius)
    )
    weight = np.where(found.clipped, 0, found.quality).astype(np.float32)
    sums = eliminate(
        found, weight, rays, gains, len(materials), lambda work: [work(0, len(chosen))]
    )
    for material, row, color in zip(materials, sums, (BLUE, ORANGE, DIM), strict=True):
        fitted = profile(row)
        said = (
            f"material {material['id']}: best at α = {material['alpha']:.0f}"
            if material["observed"]
            else f"material {material['id']}: unobserved"
        )
        axis.plot(ALPHAS, 100 * fitted.rss / fitted.total, ".-", color=color, label=said)
    for name, _, alpha in true_reflectance(scene):
        axis.axvline(alpha, color=GREEN, ls="--")
        where = axis.get_xaxis_transform()
        axis.text(alpha, 1.01, f"{name}, truth", color=GREEN, ha="center", transform=where)
    axis.set_xscale("log")
    axis.set(xlabel="shininess α", ylabel="variance left unexplained, %", ylim=(0, 105))
    axis.set_xticks([1, 10, 100, 1000], ["1", "10", "100", "1000"])
    axis.legend(loc=(0.31, 0.64))
