"""The scenes of the benchmark, declared."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .variant import GgxMaterial, Lamp, Material, Variant

# Materials: very shiny and dark, ordinary gloss, dull and bright, matte
LACQUER = Material("lacquer", 0.8, 300.0, (0.02, 0.02, 0.03), (0.05, 0.04, 0.06))
GLAZE = Material("glaze", 0.35, 40.0, (0.10, 0.03, 0.02), (0.32, 0.12, 0.06))
WAX = Material("wax", 0.15, 5.0, (0.45, 0.38, 0.22), (0.70, 0.62, 0.45))
PLASTER = Material("plaster", 0.0, 1.0, (0.10, 0.22, 0.30), (0.20, 0.38, 0.42))
FOUR = (LACQUER, GLAZE, WAX, PLASTER)

# Materials that Phong only approximates
BALL = Material("plastic ball", None, None, (0.30, 0.02, 0.02), (0.45, 0.05, 0.04), plastic=0.1)
DULL = Material("dull plastic", None, None, (0.05, 0.12, 0.30), (0.10, 0.22, 0.45), plastic=0.3)
GOLD = Material("gold", None, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), gold=0.2)
GGX_BALL = GgxMaterial("GGX plastic", None, None, BALL.dark, BALL.bright, plastic=0.15)
GGX_GOLD = GgxMaterial("GGX gold", None, None, GOLD.dark, GOLD.bright, gold=0.25)

# Two colours, each in two glosses
DULL_GLAZE = replace(GLAZE, name="dull glaze", rho_s=0.15, alpha=8.0)
POLISHED_WAX = replace(WAX, name="polished wax", rho_s=0.3, alpha=80.0)
TWINS = (GLAZE, DULL_GLAZE, WAX, POLISHED_WAX)

FLOODS = (
    Lamp("key", 35, 42, 7.0),
    Lamp("fill", -70, 22, 12.0, intensity=0.85),
    Lamp("rim", 165, 48, 9.0, intensity=0.95),
)
UNEQUAL = tuple(
    replace(lamp, intensity=gain) for lamp, gain in zip(FLOODS, (1.0, 0.25, 0.5), strict=True)
)
TUBES = tuple(
    Lamp(f"tube {k}", -150 + 60 * k, 35 if k % 2 else 55, 8.0, (14.0, 1.0), 0.6, 20.0 * k,
         kind="rectangle")
    for k in range(6)
)  # fmt: skip
WINDOW = (
    Lamp("window", -50, 25, 6.0, (22.0, 16.0), 0.8, kind="rectangle"),
    Lamp("lamp", 80, 40, 8.0),
)
BEHIND = (
    Lamp("front", 20, 40, 8.0),
    Lamp("behind left", 200, 20, 7.0),
    Lamp("behind right", 150, 45, 9.0, intensity=0.8),
)

CONVEX = Variant("floods_convex", "three floodlights near, a bumpy ball", "bumpy", FLOODS, FOUR)
CONCAVE = replace(
    CONVEX, name="floods_concave", about="the same lights, a vessel with handles", shape="vessel"
)


def _like(base: Variant, name: str, about: str, **changes: Any) -> Variant:
    return replace(base, name=name, about=about, **changes)


_ALL = (
    CONVEX,
    CONCAVE,
    _like(CONVEX, "bowl", "the same lights, a deep bowl seen from above", shape="bowl",
          elevations=(22.0, 52.0)),
    _like(CONVEX, "knot", "the same lights, a knotted tube", shape="knot"),
    # Lights
    _like(CONVEX, "tubes", "six long lamps", lamps=TUBES),
    _like(CONVEX, "unequal", "lamps of gain 1 : 1/4 : 1/2", lamps=UNEQUAL),
    _like(CONVEX, "window", "a large window and one lamp", lamps=WINDOW),
    _like(CONVEX, "single", "one single lamp", lamps=FLOODS[:1]),
    _like(CONVEX, "behind", "an arc of 150°, two of three lamps behind the object", lamps=BEHIND,
          arc=150.0),
    # Materials that Phong only approximates: judged by their images
    _like(CONVEX, "plastic", "rough plastic, two roughnesses, and plaster",
          materials=(BALL, DULL, PLASTER)),
    _like(CONCAVE, "gold", "gold, glaze and plaster", materials=(GOLD, GLAZE, PLASTER)),
    _like(CONVEX, "twins", "two colours, each in two glosses", materials=TWINS),
    # What real acquisitions suffer from
    _like(CONVEX, "noise", "sensor noise of 2 code values", noise=2.0),
    _like(CONVEX, "jpeg", "JPEG quality 60", quality=60),
    _like(CONVEX, "pose", "registration off by half a pixel", pose_error=0.5),
    _like(CONVEX, "coarse_normals", "a scan of a tenth of the triangles", coarse=10.0),
    _like(CONVEX, "few_frames", "24 frames", frames=24),
    _like(CONVEX, "short_arc", "two arcs of 60°", arc=60.0, frames=80),
    _like(CONVEX, "exposure", "automatic exposure, told in EXIF", exposure=0.15, exif=True),
    _like(CONVEX, "exposure_untold", "automatic exposure, not told", exposure=0.15),
    _like(CONVEX, "far_z_up", "at map coordinates, +Z up", offset=1e6, z_up=True),
    _like(CONCAVE, "interreflections", "the vessel with light that bounces", depth=4),
)  # fmt: skip
GGX = _like(CONVEX, "ggx", "rough plastic and gold with GGX's long tails, and plaster",
            materials=(GGX_BALL, GGX_GOLD, PLASTER))  # fmt: skip
COMPARED = tuple(variant.name for variant in _ALL)  # by the accuracy of all that is found
SCENES = {variant.name: variant for variant in (*_ALL, GGX)}
