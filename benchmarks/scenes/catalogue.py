"""The scenes of the benchmark, declared."""

from __future__ import annotations

from dataclasses import replace

from .variant import Lamp, Material, Variant

# Materials: very shiny and dark, ordinary gloss, dull and bright, matte
LACQUER = Material("lacquer", 0.8, 300.0, (0.02, 0.02, 0.03), (0.05, 0.04, 0.06), 0.08)
GLAZE = Material("glaze", 0.35, 40.0, (0.10, 0.03, 0.02), (0.32, 0.12, 0.06), 0.22)
WAX = Material("wax", 0.15, 5.0, (0.45, 0.38, 0.22), (0.70, 0.62, 0.45), 0.55)
PLASTER = Material("plaster", 0.0, 1.0, (0.10, 0.22, 0.30), (0.20, 0.38, 0.42), 1.0)
FOUR = (LACQUER, GLAZE, WAX, PLASTER)

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

CONVEX = Variant("floods_convex", "three floodlights near, a bumpy ball", "bumpy", FLOODS, FOUR)
CONCAVE = replace(
    CONVEX,
    name="floods_concave",
    about="the same lights, a vessel with handles",
    shape="vessel",
)

SCENES = {
    variant.name: variant
    for variant in (
        CONVEX,
        CONCAVE,
        replace(CONVEX, name="tubes", about="six long lamps", lamps=TUBES),
        replace(CONVEX, name="unequal", about="lamps of gain 1 : 1/4 : 1/2", lamps=UNEQUAL),
        replace(CONVEX, name="coarse_normals", about="a scan of a tenth of the triangles",
                coarse=10.0),
    )
}  # fmt: skip
