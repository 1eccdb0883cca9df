"""What an export writes, format by format."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import jpeg_of, png_of, write_exr
from meshlab_svbrdf.document.products import plain
from meshlab_svbrdf.document.record import write_json
from meshlab_svbrdf.exporting import gltf
from meshlab_svbrdf.exporting.corners import joined_vertices, textured_faces
from meshlab_svbrdf.exporting.gloss import HALF_VECTOR, Ggx, ggx_of_phong
from meshlab_svbrdf.exporting.lights import light_file, light_map
from meshlab_svbrdf.exporting.maps import LEVEL, Made, gltf_maps, pbr_maps, phong_maps
from meshlab_svbrdf.exporting.obj import ObjMaterial, mtl_text, obj_text
from meshlab_svbrdf.geometry.gutters import fill_gutters
from meshlab_svbrdf.geometry.mesh import Mesh
from meshlab_svbrdf.geometry.mikktspace import corner_tangents, in_tangent_space, tangent_frames
from meshlab_svbrdf.geometry.texels import Texels
from meshlab_svbrdf.rendering.environment_lights import Illumination
from meshlab_svbrdf.rendering.surface import Appearance
from meshlab_svbrdf.samples.luminance import decode

from ._stages import UNOBSERVED_GREY

GENERATOR = f"meshlab-svbrdf {version('meshlab-svbrdf')}"
BARE = "unobserved"
CONVERSIONS = {
    "phong": "a white surface that faces a lamp shows c; the lobe adds c rho_s (l.r)^alpha",
    "ggx": "F = 2 rho_s/(alpha + 1) at all angles, a^2 = 1/(2 (alpha + 1)): same energy, same top; "
    "of microfacets F = k F0/pi, k/pi at grazing angles, and their own a",
    "roughness": "sqrt(a)",
    "specular_level": f"F/{LEVEL:g} (Blender, Substance, Unreal; index of refraction 1.5)",
    "mtl": f"Ks (n.h)^Ns with Ks = rho_s, Ns = {HALF_VECTOR:g} alpha",
    "gltf_base_color": "albedo/(1 - F), for glTF takes F from the diffuse layer",
    "gltf_lamps": "pi c lux at the object",
    "lamps_map": "radiance along (sin f sin t, cos t, -cos f sin t), f = 2 pi (column + .5)/W, "
    "t = pi (row + .5)/H; a lamp is a disc of 1 degree, whatever its size",
}


class Package(NamedTuple):
    """What is exported.

    made : one per texture; tangents : (F, 3, 4), normals : (H, W, 3) uint8 per texture, green up;
        both None where the mesh's own normals are all there is
    shaded : whether the colour is shown unlit; jpeg : whether glTF's is stored so
    tiles : the textures' numbers, where they are UDIM tiles
    """

    name: str
    mesh: Mesh
    radius: float
    made: list[Made]
    tangents: np.ndarray | None
    normals: list[np.ndarray] | None
    light: Illumination
    ambient: np.ndarray
    shaded: bool
    jpeg: bool
    tiles: list[int]

    def stem(self, texture: int) -> str:
        """What a texture's files begin with."""
        number = self.tiles[texture] if self.tiles else texture
        return f"{self.name}_{number}" if number else self.name


def normal_maps(
    document: Document, mesh: Mesh, texels: Texels
) -> tuple[np.ndarray | None, list[np.ndarray] | None]:
    """Tangents, and images of the normals that differ from the mesh's; None without any."""
    refined = "refined_normal" in document.attributes()
    if not refined and not document.has_array("texels_detail"):
        return None, None
    normals = document.attribute("refined_normal") if refined else texels.normal
    tangents = corner_tangents(mesh)
    told = in_tangent_space(tangent_frames(texels, mesh, tangents), normals)
    codes = np.rint(255 * (np.clip(told, -1, 1) + 1) / 2).astype(np.uint8)
    inside = texels.to_images(np.ones(len(texels), bool), False)
    images = texels.to_images(codes, 128)
    return tangents, [fill_gutters(i, m) for i, m in zip(images, inside, strict=True)]


def write_gltf(folder: Path, package: Package, embed: bool) -> dict[str, str]:
    """NAME.glb, or NAME.gltf with its buffer and images."""
    builder = gltf.Builder(package.name, embed)
    mesh, count = package.mesh, len(package.made)
    two_sided = not mesh.is_closed()
    primitives = []
    for k, faces in enumerate(textured_faces(mesh, count)):
        if len(faces):
            material = _gltf_material(package, k) if k < count else _gltf_bare()
            vertices = joined_vertices(mesh, faces, None if package.shaded else package.tangents)
            index = builder.material(material, two_sided)
            primitives.append(builder.primitive(vertices, index))
    builder.object(primitives, mesh.center)
    builder.lamps(package.light, mesh.center, package.radius)
    told, data = builder.finish(GENERATOR, {"ambient_not_included": package.ambient.tolist()})
    if embed:
        (folder / f"{package.name}.glb").write_bytes(gltf.glb_of(told, data))
        return {f"{package.name}.glb": "glTF 2.0, binary, all in one"}
    (folder / f"{package.name}.gltf").write_bytes(gltf.text_of(told, f"{package.name}.bin"))
    (folder / f"{package.name}.bin").write_bytes(data)
    for image in builder.images:
        (folder / image.name).write_bytes(image.data)
    return {
        f"{package.name}.gltf": "glTF 2.0",
        f"{package.name}.bin": "its geometry",
        **{image.name: "its image" for image in builder.images},
    }


def _gltf_material(package: Package, k: int) -> gltf.Material:
    made, stem = package.made[k], f"{package.stem(k)}_glTF"
    encode, suffix = (jpeg_of, ".jpg") if package.jpeg else (png_of, ".png")
    if package.shaded:
        color = pbr_maps(made, UNOBSERVED_GREY)["BaseColor"]
        base = gltf.Image(f"{stem}_BaseColor{suffix}", encode(color))
        return gltf.Material(package.stem(k), base, unlit=True)
    maps = gltf_maps(made, UNOBSERVED_GREY)
    base = gltf.Image(f"{stem}_BaseColor{suffix}", encode(maps.base))
    normal = None
    if package.normals is not None:
        normal = gltf.Image(f"{package.stem(k)}_Normal.png", png_of(package.normals[k]))
    return gltf.Material(
        package.stem(k),
        base,
        rough=gltf.Image(f"{stem}_Roughness.png", png_of(maps.rough)),
        rough_factor=maps.rough_factor,
        specular=gltf.Image(f"{stem}_Specular.png", png_of(maps.specular)),
        specular_factor=maps.specular_factor,
        color_factor=maps.color_factor,
        tinted=bool((maps.specular[..., :3] != 255).any()),
        normal=normal,
    )


def _gltf_bare() -> gltf.Material:
    """Of faces without a texture: nothing was observed there."""
    return gltf.Material(BARE, base_factor=_grey())


def _grey() -> float:
    return float(decode(np.array(UNOBSERVED_GREY / 255)))


def write_obj(
    folder: Path, package: Package, phong: list[Appearance], scale: float
) -> dict[str, str]:
    """NAME.obj, NAME.mtl and their images."""
    materials, files = [], {}
    for k, (made, look) in enumerate(zip(package.made, phong, strict=True)):
        maps, pbr = phong_maps(look, scale), pbr_maps(made, UNOBSERVED_GREY)
        images = {
            "map_Kd": ("BaseColor", pbr["BaseColor"], "sRGB"),
            "map_Ks": ("Ks", maps.ks, f"linear; times {maps.ks_factor:.6g}"),
            "map_Ns": ("Ns", maps.ns, f"linear; times {maps.ns_factor:.6g}"),
            "map_Pr": ("Roughness", pbr["Roughness"], "linear"),
        }
        if package.normals is not None:
            images["norm"] = ("Normal", package.normals[k], "linear; tangent space, green up")
        names = {word: f"{package.stem(k)}_{what}.png" for word, (what, *_) in images.items()}
        for word, (_, image, space) in images.items():
            (folder / names[word]).write_bytes(png_of(image))
            files[names[word]] = space
        materials.append(ObjMaterial(package.stem(k), names, maps.ks_factor, maps.ns_factor))
    library = list(materials)
    if len(textured_faces(package.mesh, len(materials))[-1]):
        library.append(ObjMaterial(BARE, {}, 0.0, 1.0, _grey()))
    text = obj_text(
        package.mesh, [m.name for m in materials], BARE, f"{package.name}.mtl", GENERATOR
    )
    (folder / f"{package.name}.obj").write_text(text, encoding="utf-8")
    (folder / f"{package.name}.mtl").write_text(mtl_text(library, GENERATOR), encoding="utf-8")
    about = {f"{package.name}.obj": "the object, world coordinates", f"{package.name}.mtl": "MTL"}
    return about | files


def write_textures(folder: Path, package: Package) -> dict[str, str]:
    """One image per quantity."""
    files = {}
    for k, made in enumerate(package.made):
        images = pbr_maps(made, UNOBSERVED_GREY)
        if package.normals is not None:
            up = package.normals[k]
            down = up.copy()
            down[..., 1] = 255 - up[..., 1]
            images |= {"Normal": up, "NormalDX": down}
        for what, image in images.items():
            name = f"{package.stem(k)}_{what}.png"
            (folder / name).write_bytes(png_of(image))
            files[name] = SPACES[what]
    return files


SPACES = {
    "BaseColor": "sRGB",
    "Roughness": "linear; perceptual, the square root of a",
    "Specular": f"linear; specular level, 1 is a mirrored share of {LEVEL:g}",
    "SpecularTint": "sRGB; the highlight's colour, its largest channel 1",
    "Normal": "linear; tangent space, green up (OpenGL, Blender)",
    "NormalDX": "linear; tangent space, green down (DirectX, Unreal)",
    "Observed": "mask: red where the colour was observed, green where the gloss was",
}


def write_lights(folder: Path, package: Package, document: Document) -> dict[str, str]:
    """The lamps, as a list and as a map, and the environment map that was found."""
    name, light, ambient = package.name, package.light, package.ambient
    told = light_file(light, ambient, package.mesh.center, package.radius)
    write_json(folder / f"{name}_Lights.json", plain(told))
    write_exr(folder / f"{name}_Lights.exr", light_map(light, ambient))
    write_exr(folder / f"{name}_Environment.exr", document.image("environment"))
    return {
        f"{name}_Lights.json": "lamps and ambient light: `meshlab-svbrdf render --lights` reads it",
        f"{name}_Lights.exr": "linear radiance, latitude-longitude, pole +Y",
        f"{name}_Environment.exr": "where light was seen to come from, 0 to 1, the same layout",
    }


def write_format(
    name: str, folder: Path, package: Package, phong: list[Appearance], scale: float,
    document: Document,
) -> dict[str, str]:  # fmt: skip
    """Write one of FORMATS; the files, with what each is.

    phong : the lobes, for OBJ
    """
    writers: dict[str, Callable[[], dict[str, str]]] = {
        "gltf": lambda: write_gltf(folder, package, False),
        "glb": lambda: write_gltf(folder, package, True),
        "obj": lambda: write_obj(folder, package, phong, scale),
        "textures": lambda: write_textures(folder, package),
        "lights": lambda: write_lights(folder, package, document),
    }
    return writers[name]()


FORMATS = ("gltf", "glb", "obj", "textures", "lights")


def write_account(
    folder: Path, document: Document, package: Package, files: dict[str, str],
    coverage: dict[str, float], parameters: dict[str, Any],
) -> None:  # fmt: skip
    """NAME.json: what was exported, made by what, converted how."""
    told = {
        "format": 1,
        "generator": GENERATOR,
        "object": package.name,
        "color": "diffuse, with its light" if package.shaded else "albedo",
        "parameters": {k: str(v) if isinstance(v, Path) else v for k, v in parameters.items()},
        "coverage": coverage,
        "conversions": CONVERSIONS,
        "files": files,
        "materials": [_converted(m) for m in document.json("materials")["materials"]],
        "center": package.mesh.center,
        "radius": package.radius,
        "lights": light_file(
            package.light, package.ambient, package.mesh.center, package.radius
        ),
        "runs": document.results.record["runs"],
    }  # fmt: skip
    write_json(folder / f"{package.name}.json", plain(told))


def _converted(material: dict[str, Any]) -> dict[str, Any]:
    """A material's entry in materials.json, with its gloss as GGX, as the textures have it; no
    colour of an unseen one."""
    if found := material.get("reflectance"):
        grazing = found["strength"] / np.pi
        ggx = Ggx(found["f0"] * grazing, grazing, found["roughness"])
    elif material["rho_s_lobe"] is None:
        return material | {"specular_color": None}
    else:
        ggx = ggx_of_phong(material["rho_s_lobe"], material["alpha_lobe"])
    return material | {
        "ggx": {
            "mirrored": float(ggx.facing), "mirrored_at_grazing": float(ggx.grazing),
            "a": float(ggx.roughness), "roughness": float(np.sqrt(ggx.roughness)),
        }
    }  # fmt: skip
