"""The report's tables and plots: lights, materials, coverage, residuals."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.reflectance.density import highest_bell
from meshlab_svbrdf.reflectance.labels import palette
from meshlab_svbrdf.rendering.colors import viridis
from meshlab_svbrdf.reporting.html import Html, figure, join, note, picture, section, table, tag
from meshlab_svbrdf.reporting.plots import Series, chart, histogram
from meshlab_svbrdf.samples.luminance import decode

from ._materials import read_names
from ._matte import matte_texels
from ._report_pictures import missing, shown, side_name, sides, swatch

BLUE = "#3a6ea5"
EXPOSURES = {"none": "not told", "exif": "from EXIF", "raster": "told in the project"}
EVIDENCE = (
    "z: ρs over its standard error. Interval of ln α: how wide the span of ln α is in "
    "which the fit is about as good; of 0.1, α is known to 10 % across. –: not known."
)
WIDEST = 60.0
"""Degrees from the mirror direction at which lobes end in the plot."""


def lights(document: Document) -> Html:
    """The environment map with the lights marked, and what is known of them."""
    title, parts = "Light", []
    said = missing(document, "environment", "generate_svbrdf_environment_map")
    if said is not None:
        return section(title, said)
    marked = (document.folder / "environment.png").is_file()
    image = document.image("environment", "png" if marked else "exr")
    if not marked:
        image = np.repeat(np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)[..., None], 3, -1)
    caption = (
        "Where light came from: latitude and longitude, world +Y at the top; lights are ringed."
    )
    parts.append(picture(image[..., :3], caption, 960))
    said = missing(document, "lights", "compute_svbrdf_light_sources")
    if said is not None:
        return section(title, *parts, said)
    told = document.json("lights")
    rows = []
    for k, light in enumerate(told["lights"]):
        place = light["position"]
        rows.append(
            (
                str(k), _vector(light["direction"]), "far" if place is None else _vector(place),
                f"{light['gain']:.3f}",
                f"{np.degrees(np.sqrt(np.trace(np.array(light['covariance'])) / 2)):.1f}°",
            )
        )  # fmt: skip
    parts.append(
        table(("light", "direction from the centre", "position", "gain", "width as seen"), rows)
    )
    ambient = told.get("ambient")
    parts.append(
        note(
            "Ambient light: not known." if ambient is None
            else f"Ambient light, of a lamp's: {_vector(ambient)} (R, G, B)."
        )
    )  # fmt: skip
    return section(title, *parts)


def materials(document: Document) -> Html:
    """The table of materials, their lobes, and the densities of their texels' own ρs and α."""
    title = "Materials"
    said = missing(document, "material_specular", "compute_svbrdf_material_specular")
    if said is not None:
        return section(title, said)
    told, names = document.json("materials"), read_names(document)
    found = told["materials"]
    labels = document.attribute("material")
    used = [int(k) for k in np.unique(labels[labels >= 0])]
    colors = dict(zip(used, palette(len(used)), strict=True))
    rows, lobes = [], []
    theta = np.linspace(0, WIDEST, 200)
    for m in found:
        color, seen = colors.get(m["id"], np.zeros(3, np.uint8)), m["observed"]
        model = m.get("reflectance")
        rows.append(
            (
                join([swatch(color), f"{m['id']} {names.get(m['id'], '')}"]),
                f"{m['texels']:,}", _number(m["rho_s"], ".4f"), _number(m["alpha"], ".2f"),
                *(
                    (
                        _vector(m["specular_color"]), _number(m.get("explained_variance"), ".3f"),
                        _number(m.get("z"), ".0f"), _number(m.get("ln_alpha_interval"), ".2f"),
                    ) if seen else "––––"
                ),
                _described(model) if model else "observed" if seen else m["reason"],
            )
        )  # fmt: skip
        if m["observed"]:
            lobe = m["rho_s_lobe"] * np.cos(np.radians(theta)) ** m["alpha_lobe"]
            lobes.append(Series(theta, lobe, _css(color), label=f"{m['id']}"))
    heads = (
        "material", "texels", "ρs", "α", "colour of the highlight", "variance explained", "z",
        "interval of ln α", "",
    )  # fmt: skip
    plots = []
    if lobes:
        drawn = chart(lobes, "degrees from the mirror direction", "ρs cos^α, 1 = white")
        plots.append(figure(drawn, "Lobes of the observed materials"))
    plots += _densities(document, found, labels, colors)
    peaks = missing(document, "texel_specular", "compute_svbrdf_texel_specular")
    if peaks is not None:
        plots.append(
            note(
                "Densities of single texels' ρs and α are not shown: compute_svbrdf_texel_specular "
                "has not run (the joint fit needs no single peaks).", "missing",
            )
        )  # fmt: skip
    return section(
        title, note(f"Estimator: {told['estimator']}. As seen, under lights of mean gain 1."),
        table(heads, rows, 8), note(EVIDENCE), tag("div", *plots, class_="grid"),
    )  # fmt: skip


def _described(model: dict[str, Any]) -> str:
    return (
        f"{model['model']} describes it {model['gain_db']:.1f} dB better: roughness "
        f"{model['roughness']:.3f}, F₀ {model['f0']:.3f}, strength {model['strength']:.4g}"
    )


def coverage(document: Document) -> Html:
    """How often the texels were seen, and what their luminance is."""
    title = "Coverage"
    said = missing(document, "samples", "compute_svbrdf_samples")
    if said is not None:
        return section(title, said)
    plots: list[Html] = []
    views: list[Html] = []
    lines = []
    for name, words in (
        ("frames", "frames in which a texel is seen"),
        ("samples", "samples good enough for the threshold"),
        ("threshold", "luminance threshold, 0 to 100"),
    ):
        if name not in document.attributes():
            continue
        values = np.asarray(document.attribute(name), float)
        known = values[np.isfinite(values)]
        bars = histogram(values)
        if bars is None:
            continue
        caption = f"median {np.median(known):.4g}, {known.min():.4g} to {known.max():.4g}"
        plots.append(figure(chart([bars], words, "% of texels"), caption))
        if name == "frames":
            worn = matte_texels(document, decode(viridis(values / known.max()) / 255))
            views += [
                picture(shown(worn, camera), f"{side_name(k)}: {words}, 0 to {known.max():g}")
                for k, camera in list(enumerate(sides(document)))[::2]
            ]
            lines.append(f"{100 * (values > 0).mean():.1f} % of the texels are seen in some frame")
    if document.has("threshold"):
        observed = np.isfinite(document.attribute("threshold"))
        lines.append(f"{100 * observed.mean():.1f} % are observed: seen in 8 frames or more")
    return section(
        title, note("; ".join(lines) + "."), tag("div", *plots, class_="grid"),
        tag("div", *views, class_="strip few"),
    )  # fmt: skip


def residuals(document: Document) -> Html:
    """What each frame leaves unexplained, and the gains."""
    title = "Residuals"
    said = missing(document, "samples", "compute_svbrdf_samples")
    if said is not None:
        return section(title, said)
    told = document.json("frames")
    used = [frame for frame in told["frames"] if "samples" in frame]
    at, plots = np.arange(len(used)), []
    for key, words in (("residual", "residual"), ("samples", "samples"), ("quality", "quality")):
        values = np.array([_float(frame.get(key)) for frame in used])
        if np.isfinite(values).any():
            drawn = chart([Series(at, values, BLUE, "dots")], "frame, in order", words)
            plots.append(figure(drawn, f"{words} per frame: median {_median(values)}"))
    if told["gains_fitted"]:
        gains = np.array([frame["gain"] for frame in used], float)
        series = [
            Series(at, own, color)
            for own, color in zip(gains.T, ("#c0453b", "#3f8f4f", BLUE), strict=True)
        ]
        plots.append(figure(chart(series, "frame, in order", "gain"), "fitted gains (R, G, B)"))
    words = (
        f"{len(used)} frames used. Residual: mean |ln| between a frame's samples and the texels' "
        "diffuse colour. Exposure: "
        + {"none": "not told", "exif": "from EXIF", "raster": "told in the project"}[
            told["exposure"]
        ]
        + ("; gains fitted." if told["gains_fitted"] else "; no gains fitted.")
    )
    return section(title, note(words), tag("div", *plots, class_="grid"))


def _densities(
    document: Document, found: list[dict[str, Any]], labels: np.ndarray,
    colors: dict[int, np.ndarray],
) -> list[Html]:  # fmt: skip
    if not document.has("texel_specular"):
        return []
    made = []
    rho_s, alpha = (np.asarray(document.attribute(name), float) for name in ("rho_s", "alpha"))
    of_rho: list[Series] = []
    of_alpha: list[Series] = []
    for m in found:
        own, color = labels == m["id"], _css(colors.get(m["id"], np.zeros(3, np.uint8)))
        for series, values, others in ((of_rho, rho_s, alpha), (of_alpha, alpha, rho_s)):
            bell = highest_bell(values[own], others[own])
            if bell is not None and np.isfinite(bell.density).all():
                series.append(Series(bell.x, bell.density, color, label=str(m["id"])))
        if m["observed"]:
            of_rho.append(Series(np.array([m["rho_s"]]), np.zeros(1), color, "mark"))
            of_alpha.append(Series(np.array([m["alpha"]]), np.zeros(1), color, "mark"))
    for series, words in ((of_rho, "ρs of single texels"), (of_alpha, "α of single texels")):
        if any(s.kind == "line" for s in series):
            drawn = chart(series, words, "density of its logarithm", True)
            made.append(figure(drawn, f"{words}; dashed: the material's"))
    return made


def _css(color: np.ndarray) -> str:
    """A colour (3,) uint8, dark enough to be seen on white."""
    hsv = cv2.cvtColor(np.asarray(color, np.uint8)[None, None], cv2.COLOR_RGB2HSV)
    hsv[..., 2] = np.minimum(hsv[..., 2], 190)
    return "#" + "".join(f"{c:02x}" for c in cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0])


def _vector(values: Any) -> str:
    return ", ".join(f"{v:.3f}" for v in values)


def _median(values: np.ndarray) -> str:
    median = np.nanmedian(values)
    return f"{median:,.0f}" if median >= 1000 else f"{median:.4g}"


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _float(value: float | None) -> float:
    return float("nan") if value is None else float(value)
