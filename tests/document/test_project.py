"""Projects: what we do not know survives, paths follow the file, bad files say what is wrong."""

import base64
import os
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pymeshlab
import pytest

from meshlab_svbrdf.document.cameras import same_camera
from meshlab_svbrdf.document.project import new_project, read_project, write_project
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.camera import Camera

CAMERA = (
    '<VCGCamera CameraType="0" BinaryData="0" FocalMm="15.0000000000000010" LensDistortion="0 0" '
    'PixelSizeMm="0.01 0.01" ViewportPx="8 6" CenterPx="4.25 3" '
    'RotationMatrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 " '
    'TranslationVector="0.10000000000000001 2 -3 1"/>'
)
TEXT = f"""<?xml version="1.0"?>
<!-- by hand -->
<!DOCTYPE MeshLabDocument>
<MeshLabProject version="x">
 <!-- kept -->
 <MeshGroup>
  <!-- MeshLab would take this for a mesh -->
  <MLMesh label="böse &amp; &lt;gut&gt;"
   filename="meshes/a.ply" visible="0" idInFile="-1" color="red">
   <MLMatrix44>
1 0 0 0.1000000000000000055
0 1 0 1e6
0 0 2 0
0 0 0 1
</MLMatrix44>
   <RenderingOption pointSize="3">100110</RenderingOption>
  </MLMesh>
 </MeshGroup>
 <RasterGroup>
  <MLRaster label="f0" svbrdf_sequence="front" svbrdf_exposure="1.50">
   <Plane semantic="1" fileName="frames/f0.png"/>
   {CAMERA}
   <Plane semantic="2" fileName="frames/depth.png"/>
   <Note by="me"/>
  </MLRaster>
  <MLRaster label="f1">{CAMERA}<Plane semantic="1" fileName="frames/f1.png"/></MLRaster>
 </RasterGroup>
 <Unknown><Deep a="1"/></Unknown>
</MeshLabProject>
"""


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "with space"
    for name in ("meshes/a.ply", "frames/f0.png", "frames/f1.png", "masks/f1.png"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(b"")
    (root / "p.mlp").write_text(TEXT, encoding="utf-8")
    return root


def canonical(element: ET.Element) -> str:
    return ET.canonicalize(ET.tostring(element, encoding="unicode"), strip_text=True)


def test_reads_what_the_file_says(folder):
    project = read_project(folder / "p.mlp")
    mesh = project.mesh("böse & <gut>")
    assert mesh.path == folder / "meshes/a.ply"
    assert not mesh.visible
    np.testing.assert_array_equal(mesh.matrix[:, 3], [0.1, 1e6, 0, 1])
    first, second = project.rasters
    assert (first.sequence, first.exposure, first.mask) == ("front", 1.5, None)
    assert (second.sequence, second.exposure) == ("frames", None)
    assert second.mask == folder / "masks/f1.png"
    assert first.camera.cx == 3.75


def test_what_is_not_changed_keeps_its_characters(folder):
    project = read_project(folder / "p.mlp")
    write_project(project, folder / "q.mlp")
    text = (folder / "q.mlp").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE MeshLabDocument>\n")
    for piece in (
        'FocalMm="15.0000000000000010"',
        "0.1000000000000000055",
        'svbrdf_exposure="1.50"',
        "<!-- by hand -->",
        "<!-- kept -->",
        '<RenderingOption pointSize="3">100110</RenderingOption>',
        'color="red"',
        "<Unknown>",
        '<Note by="me" />',
        'fileName="frames/depth.png"',
    ):
        assert piece in text
    assert "take this for a mesh" not in text
    raster = ET.fromstring(text).find("RasterGroup/MLRaster")
    assert raster is not None
    assert raster[0].tag == "VCGCamera"
    assert raster[1].get("fileName") == "frames/f0.png"

    # Written again it stays as it is
    write_project(read_project(folder / "q.mlp"), folder / "r.mlp")
    assert (folder / "r.mlp").read_text(encoding="utf-8") == text


def test_paths_follow_the_project_to_another_folder(folder):
    project = read_project(folder / "p.mlp")
    (folder / "out").mkdir()
    write_project(project, folder / "out/p.mlp")
    text = (folder / "out/p.mlp").read_text(encoding="utf-8")
    assert 'filename="../meshes/a.ply"' in text
    assert 'fileName="../frames/depth.png"' in text
    moved = read_project(folder / "out/p.mlp")
    for old, new in zip(project.rasters, moved.rasters, strict=True):
        assert (new.path, new.mask, new.sequence) == (old.path, old.mask, old.sequence)
        assert same_camera(old.camera, new.camera)
    assert project.path == folder / "p.mlp"
    write_project(moved, folder / "back.mlp")
    assert read_project(folder / "back.mlp").meshes[0].path == project.meshes[0].path


def test_mlb_and_back_is_exact(folder):
    project = read_project(folder / "p.mlp")
    write_project(project, folder / "p.mlb")
    binary = read_project(folder / "p.mlb")
    element = binary.rasters[0].element.find("VCGCamera")
    assert element is not None
    assert len(base64.b64decode(element.attrib["TranslationVector"])) == 3 * 8
    write_project(binary, folder / "q.mlp")
    for other in (binary, read_project(folder / "q.mlp")):
        np.testing.assert_array_equal(other.meshes[0].matrix, project.meshes[0].matrix)
        for a, b in zip(project.rasters, other.rasters, strict=True):
            assert same_camera(a.camera, b.camera)


def test_single_precision_mlb_is_read(folder):
    project = read_project(folder / "p.mlp")
    write_project(project, folder / "p.mlb")
    root = ET.parse(folder / "p.mlb").getroot()
    for camera in root.iter("VCGCamera"):
        for name in ("FocalMm", "PixelSizeMm", "CenterPx", "RotationMatrix", "TranslationVector"):
            values = np.frombuffer(base64.b64decode(camera.attrib[name]), "<f8").astype("<f4")
            camera.set(name, base64.b64encode(values.tobytes()).decode())
    for matrix in root.iter("MLMatrix44"):
        values = np.frombuffer(base64.b64decode(matrix.text or ""), "<f8").astype("<f4")
        matrix.text = base64.b64encode(values.tobytes()).decode()
    (folder / "single.mlb").write_bytes(ET.tostring(root))
    single = read_project(folder / "single.mlb")
    np.testing.assert_array_equal(
        single.meshes[0].matrix, project.meshes[0].matrix.astype(np.float32)
    )
    np.testing.assert_allclose(single.rasters[0].camera.t, project.rasters[0].camera.t, rtol=1e-6)


def test_layers_are_added_and_replaced(folder):
    project = read_project(folder / "p.mlp")
    label = project.meshes[0].label
    project.set_mesh(label, folder / "frames/f0.png", visible=True)
    project.set_mesh("new", folder / "frames/f1.png", np.diag([2.0, 2, 2, 1]), visible=False)
    with pytest.raises(DocumentError, match="exists already"):
        project.add_mesh("new", folder / "frames/f1.png")
    with pytest.raises(DocumentError, match="affine"):
        project.add_mesh("flat", folder / "frames/f1.png", np.diag([1.0, 1, 0, 1]))
    write_project(project, folder / "q.mlp")
    back = read_project(folder / "q.mlp")
    assert [(m.label, m.visible) for m in back.meshes] == [(label, True), ("new", False)]
    assert back.meshes[0].element.find("RenderingOption") is not None
    np.testing.assert_array_equal(back.meshes[0].matrix, np.eye(4))
    np.testing.assert_array_equal(back.meshes[1].matrix, np.diag([2.0, 2, 2, 1]))


def test_a_project_from_scratch_comes_back(folder):
    project = new_project()
    camera = Camera(8, 6, 7.0, 7.5, 3.5, 2.5, np.eye(3), np.array([0.0, 0, 4]))
    project.add_mesh("a", folder / "meshes/a.ply", np.diag([2.0, 3, 4, 1]))
    project.add_raster("f0", folder / "frames/f0.png", camera)
    project.add_raster(
        "f1",
        folder / "frames/f1.png",
        camera,
        sequence="s",
        exposure=0.75,
        mask=folder / "masks/f1.png",
    )
    with pytest.raises(DocumentError, match="exists already"):
        project.add_raster("f0", folder / "frames/f0.png", camera)
    write_project(project, folder / "new.mlp")
    back = read_project(folder / "new.mlp")
    assert str(folder) not in (folder / "new.mlp").read_text(encoding="utf-8")
    assert [(r.sequence, r.exposure) for r in back.rasters] == [("frames", None), ("s", 0.75)]
    assert [r.mask for r in back.rasters] == [None, folder / "masks/f1.png"]
    assert same_camera(back.rasters[0].camera, camera)


def test_a_mask_can_be_named_and_refused(folder):
    project = read_project(folder / "p.mlp")
    project.rasters[0].mask = folder / "frames/f1.png"
    project.rasters[1].mask = None
    project.rasters[0].exposure = None
    write_project(project, folder / "q.mlp")
    back = read_project(folder / "q.mlp")
    assert [r.mask for r in back.rasters] == [folder / "frames/f1.png", None]
    assert back.rasters[0].exposure is None


def test_two_frames_cannot_take_one_mask_by_name(folder):
    (folder / "other").mkdir()
    shutil.copy(folder / "frames/f1.png", folder / "other/f1.png")
    edit(folder, 'fileName="frames/f0.png"', 'fileName="other/f1.png"')
    with pytest.raises(DocumentError, match="svbrdf_mask"):
        read_project(folder / "p.mlp")


def edit(folder: Path, old: str, new: str) -> None:
    assert old in TEXT
    (folder / "p.mlp").write_text(TEXT.replace(old, new), encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("</MeshGroup>", "", "well-formed"),
        ("<!DOCTYPE MeshLabDocument>", '<!DOCTYPE m [<!ENTITY a "b">]>', "entity 'a'"),
        (
            "<!DOCTYPE MeshLabDocument>",
            '<!DOCTYPE m [<!ENTITY e SYSTEM "file:///etc/hostname">]>',
            "entity 'e'",
        ),
        ("<!DOCTYPE MeshLabDocument>", '<!DOCTYPE m [<!ENTITY % p "q">]>', "entity 'p'"),
        ("</MeshGroup>", f"{'<a>' * 999}{'</a>' * 999}</MeshGroup>", r"line \d+: <a> lies in 100"),
        ('label="f1"', 'label="f0"', "2 rasters are labelled 'f0'"),
        ("meshes/a.ply", "meshes/b.ply", "do not exist"),
        ('filename="meshes/a.ply"', 'filename=""', "no file"),
        ("0 0 2 0\n", "0 0 2\n", "MLMatrix44: expected 16"),
        ("0 0 2 0\n", "0 0 nan 0\n", "finite"),
        ("0 0 0 1\n<", "0 0 1 1\n<", "affine"),
        ('svbrdf_exposure="1.50"', 'svbrdf_exposure="-1"', "raster 'f0'.*exposure"),
        ('<Plane semantic="1" fileName="frames/f1.png"/>', "", "raster 'f1' has no image"),
    ],
)
def test_bad_projects_say_what_is_wrong(folder, old, new, says):
    edit(folder, old, new)
    with pytest.raises(DocumentError, match=says) as caught:
        read_project(folder / "p.mlp")
    assert "p.mlp" in str(caught.value)


def test_a_missing_and_a_foreign_file_are_refused(folder):
    with pytest.raises(DocumentError, match=r"none\.mlp"):
        read_project(folder / "none.mlp")
    (folder / "x.mlp").write_text("<html/>")
    with pytest.raises(DocumentError, match="not a MeshLab project"):
        read_project(folder / "x.mlp")


def test_a_write_that_fails_leaves_the_old_file(folder):
    project = read_project(folder / "p.mlp")
    before = sorted(folder.iterdir())
    project.rasters[0].exposure = -1.0
    with pytest.raises(DocumentError, match="exposure"):
        write_project(project, folder / "p.mlp")
    assert (folder / "p.mlp").read_text(encoding="utf-8") == TEXT
    assert sorted(folder.iterdir()) == before
    with pytest.raises(DocumentError, match="folder does not exist"):
        write_project(read_project(folder / "p.mlp"), folder / "nowhere/p.mlp")


@pytest.mark.parametrize("suffix", ["mlp", "mlb"])
def test_pymeshlabs_own_projects_round_trip(tmp_path, suffix):
    cv2.imwrite(str(tmp_path / "f0.png"), np.zeros((6, 8, 3), np.uint8))
    meshes = pymeshlab.MeshSet()
    meshes.create_cube()
    meshes.save_current_mesh(str(tmp_path / "a.ply"))
    project = new_project()
    matrix = np.array([[0, -2, 0, 0.1], [2, 0, 0, 7], [0, 0, 2, 0], [0, 0, 0, 1.0]])
    camera = Camera(8, 6, 7.125, 7.25, 3.75, 2.25, np.eye(3), np.array([0.5, 0, 4]))
    project.add_mesh("a", tmp_path / "a.ply", matrix)
    project.add_raster("f0", tmp_path / "f0.png", camera)
    write_project(project, tmp_path / f"ours.{suffix}")

    # MeshLab reads ours and writes its own; we read that, write it, and MeshLab reads it again
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(tmp_path / f"ours.{suffix}"))
    np.testing.assert_allclose(meshes.current_mesh().transform_matrix(), matrix, atol=1e-6)
    meshes.save_project(str(tmp_path / f"theirs.{suffix}"))
    theirs = read_project(tmp_path / f"theirs.{suffix}")
    np.testing.assert_allclose(theirs.meshes[0].matrix, matrix, atol=1e-6)
    tolerance = 1e-4 if suffix == "mlp" else 1e-12
    np.testing.assert_allclose(theirs.rasters[0].camera.K, camera.K, atol=tolerance)
    np.testing.assert_allclose(theirs.rasters[0].camera.t, camera.t, atol=tolerance)
    write_project(theirs, tmp_path / f"again.{suffix}")
    again = read_project(tmp_path / f"again.{suffix}")
    assert same_camera(again.rasters[0].camera, theirs.rasters[0].camera)
    meshes = pymeshlab.MeshSet()
    meshes.load_project(str(tmp_path / f"again.{suffix}"))
    assert (meshes.mesh_number(), meshes.raster_number()) == (1, 1)


@pytest.mark.parametrize("scene", ["bust_floods", "goldcape"])
def test_the_scenes_round_trip(scene, tmp_path):
    scenes = os.environ.get("MESHLAB_SVBRDF_SCENES")
    if not scenes:
        pytest.skip("MESHLAB_SVBRDF_SCENES does not name the folder of scenes")
    project = read_project(Path(scenes) / scene / f"{scene}.mlp")
    write_project(project, tmp_path / "p.mlb")
    write_project(read_project(tmp_path / "p.mlb"), tmp_path / "p.mlp")
    back = read_project(tmp_path / "p.mlp")
    for a, b in zip(project.rasters, back.rasters, strict=True):
        assert same_camera(a.camera, b.camera)
        assert (a.label, a.path, a.mask, a.sequence) == (b.label, b.path, b.mask, b.sequence)
    assert all(r.mask for r in project.rasters) == (scene == "goldcape")
