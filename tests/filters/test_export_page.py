"""The export of a small film's result: every file, as other programs read them."""

import json

import numpy as np
import pytest
from exported import judge_gltf, show_in_three
from scores import psnr
from totems import VIDEO, contents, copied, film
from typer.testing import CliRunner

from meshlab_svbrdf import cli
from meshlab_svbrdf.document.document import Document
from meshlab_svbrdf.document.images import read_exr, read_image
from meshlab_svbrdf.document.mesh_files import read_mesh
from meshlab_svbrdf.document.project import read_project
from meshlab_svbrdf.errors import SvbrdfError
from meshlab_svbrdf.exporting.gloss import ggx_of_phong
from meshlab_svbrdf.samples.luminance import decode, to_srgb8

ALBEDO, EXPORT, RELIGHT = (
    "compute_svbrdf_albedo",
    "generate_svbrdf_export",
    "generate_svbrdf_relighting",
)
ALL = "gltf glb obj textures lights"


@pytest.fixture
def result(tmp_path_factory, tmp_path) -> Document:
    return copied(tmp_path_factory, VIDEO, tmp_path / "result")


@pytest.fixture
def lit(result) -> Document:
    result.apply(ALBEDO)
    return result


def with_turned_normals(document: Document) -> None:
    """Give the result normals that a fit would have corrected, in waves."""
    texels = document.texels()
    wave = 0.25 * np.sin(12 / texels.radius * texels.position[:, [1, 2, 0]])
    normals = texels.normal + wave
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    with document.write("material_specular", edits=("material_specular",)):
        document.set_attribute("refined_normal", normals.astype(np.float32))


def test_every_file_is_what_it_says(lit, tmp_path):
    before = contents(lit.folder)
    out = tmp_path / "out"
    said = lit.apply(EXPORT, folder=out, formats=ALL).message
    assert contents(lit.folder) == before
    told = json.loads((out / "totem.json").read_text())
    assert sorted([*told["files"], "totem.json"]) == sorted(p.name for p in out.iterdir())
    assert said.startswith(f"{len(told['files']) + 1} files in {out}")

    # The maps come back from the textures
    albedo, rho_s, alpha = (lit.map(name)[0] for name in ("albedo", "rho_s", "alpha"))
    known, glossy = np.isfinite(albedo).all(-1), np.isfinite(rho_s)
    color = read_image(out / "totem_BaseColor.png")
    np.testing.assert_array_equal(color[known], to_srgb8(albedo)[known])
    rough = read_image(out / "totem_Roughness.png")[glossy] / 255
    expected = np.sqrt(ggx_of_phong(rho_s, alpha).roughness[glossy])
    np.testing.assert_allclose(rough, expected, atol=0.51 / 255)
    observed = read_image(out / "totem_Observed.png")
    np.testing.assert_array_equal(observed[..., 0] == 255, known)
    np.testing.assert_array_equal(observed[..., 1] == 255, glossy)
    assert told["coverage"]["color_unobserved"] == pytest.approx(
        1 - known.sum() / told["coverage"]["texels"]
    )

    # The mesh comes back from the OBJ, the lamps from their file and their map
    mesh, found = lit.mesh(), read_mesh(out / "totem.obj")
    np.testing.assert_allclose(found.mesh.vertices, mesh.vertices, rtol=1e-11, atol=1e-11)
    np.testing.assert_array_equal(found.mesh.faces, mesh.faces)
    np.testing.assert_allclose(found.mesh.uv, mesh.uv, atol=1e-6)
    assert [path.name for path in found.textures] == ["totem_BaseColor.png"]
    lights, lamps = lit.json("lights"), json.loads((out / "totem_Lights.json").read_text())
    np.testing.assert_allclose(
        [lamp["position"] for lamp in lamps["lights"]],
        [light["position"] for light in lights["lights"]],
    )
    assert read_exr(out / "totem_Lights.exr").shape == (512, 1024, 3)
    np.testing.assert_array_equal(
        read_exr(out / "totem_Environment.exr"), read_exr(lit.folder / "environment.exr")
    )


@pytest.mark.parametrize("name", ["totem.glb", "totem.gltf"])
@pytest.mark.parametrize("turned", [False, True])
def test_khronos_finds_nothing_to_say(result, tmp_path, name, turned):
    if turned:
        with_turned_normals(result)
    result.apply(ALBEDO)
    out = tmp_path / "out"
    result.apply(
        EXPORT, folder=out, formats="gltf glb", color_images="jpeg" if turned else "png",
        color="diffuse" if turned and name == "totem.gltf" else "albedo",
    )  # fmt: skip
    assert judge_gltf(out / name) == []


def test_three_js_shows_what_is_rendered_here(result, tmp_path_factory, tmp_path):
    """With normals of its own: they, the albedo, the gloss and the lamps are all in the picture."""
    with_turned_normals(result)
    result.apply(ALBEDO)
    out = tmp_path / "out"
    result.apply(EXPORT, folder=out, formats="glb lights", color="albedo", unobserved="nearest")
    told = json.loads((out / "totem_Lights.json").read_text()) | {"ambient": None}
    (tmp_path / "lamps.json").write_text(json.dumps(told))
    cameras = film(tmp_path_factory, VIDEO).parent / "ground_truth" / "views" / "project.mlp"
    camera = read_project(cameras).rasters[0].camera
    theirs = to_srgb8(show_in_three(out / "totem.glb", camera))
    result.apply(RELIGHT, lights=tmp_path / "lamps.json", cameras=cameras, folder=tmp_path,
              shadows=False)  # fmt: skip
    # Measured 34.0; without the normal map 23.4
    assert psnr(read_image(tmp_path / "view_00.png"), theirs)[0] > 32


def test_normals_are_in_both_conventions(result, tmp_path):
    with_turned_normals(result)
    result.apply(ALBEDO)
    result.apply(EXPORT, folder=tmp_path / "out", formats="textures obj")
    up, down = (read_image(tmp_path / "out" / f"totem_{n}.png") for n in ("Normal", "NormalDX"))
    np.testing.assert_array_equal(up[..., [0, 2]], down[..., [0, 2]])
    np.testing.assert_array_equal(up[..., 1], 255 - down[..., 1])
    assert "norm totem_Normal.png" in (tmp_path / "out" / "totem.mtl").read_text()


def test_without_albedo_the_shaded_colour_is_unlit_and_that_is_said(result, tmp_path):
    said = result.apply(EXPORT, folder=tmp_path / "out", formats="gltf textures").message
    assert "light and shadow, unlit" in said
    told = json.loads((tmp_path / "out" / "totem.gltf").read_text())
    assert told["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    codes = read_image(tmp_path / "out" / "totem_BaseColor.png")
    np.testing.assert_array_equal(read_image(tmp_path / "out" / "totem_glTF_BaseColor.png"), codes)
    color = decode(codes / 255)
    diffuse = result.map("diffuse")[0]
    known = np.isfinite(diffuse).all(-1)
    assert np.median(np.abs(color[known] - np.clip(diffuse[known], 0, 1))) < 0.02


def test_an_albedo_of_old_is_refused(lit, tmp_path):
    with_turned_normals(lit)
    with pytest.raises(SvbrdfError, match="albedo is older than the material specular: run"):
        lit.apply(EXPORT, folder=tmp_path / "out")


def test_a_scale_darkens_the_object_and_brightens_its_lamps(lit, tmp_path):
    for name, scale in (("one", 1.0), ("half", 0.5)):
        lit.apply(EXPORT, folder=tmp_path / name, formats="gltf lights", scale=scale)
    one, half = (json.loads((tmp_path / n / "totem.gltf").read_text()) for n in ("one", "half"))
    lamps = [t["extensions"]["KHR_lights_punctual"]["lights"] for t in (one, half)]
    for a, b in zip(*lamps, strict=True):
        assert b["intensity"] == pytest.approx(2 * a["intensity"])
    shares = [
        t["materials"][0]["extensions"]["KHR_materials_specular"]["specularFactor"]
        for t in (one, half)
    ]
    assert shares[1] == pytest.approx(shares[0] / 2)
    maps = [read_exr(tmp_path / n / "totem_Lights.exr") for n in ("one", "half")]
    np.testing.assert_allclose(maps[1], 2 * maps[0], rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"formats": "glb fbx"}, "no format 'fbx': choose of gltf, glb"),
        ({"formats": ","}, "no format is given"),
        ({"folder": ""}, "folder is empty"),
        ({"lights": "nowhere.json"}, "nowhere.json: cannot be read"),
    ],
)
def test_what_cannot_be_exported_is_said(lit, tmp_path, given, said):
    with pytest.raises(SvbrdfError, match=said):
        lit.apply(EXPORT, **{"folder": tmp_path / "out"} | given)
    assert not (tmp_path / "out").exists()


def test_a_format_that_breaks_leaves_no_file(lit, tmp_path, monkeypatch):
    def breaks(*_):
        raise OSError("the disk is full")

    monkeypatch.setattr("meshlab_svbrdf.filters._export.write_lights", breaks)
    (tmp_path / "out").mkdir()
    with pytest.raises(OSError, match="full"):
        lit.apply(EXPORT, folder=tmp_path / "out", formats="glb lights")
    assert list((tmp_path / "out").iterdir()) == []


def test_the_shell_makes_the_albedo_first(result, tmp_path):
    path = result.save()
    words = ["export", path, "-o", tmp_path / "out", "--format", "glb", "--unobserved", "nearest"]
    done = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    assert [line.split()[0] for line in done.stdout.splitlines()[:2]] == [ALBEDO, EXPORT]
    assert (tmp_path / "out" / "totem.glb").is_file()
    again = CliRunner().invoke(cli.app, [str(word) for word in [*words, "--shaded", "--json"]])
    assert [stage["name"] for stage in json.loads(again.stdout)["stages"]] == [EXPORT]


def test_the_shell_says_what_there_is_nothing_of(tmp_path_factory, tmp_path):
    words = ["export", str(film(tmp_path_factory, VIDEO)), "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 1
    assert "no results to export" in done.output
