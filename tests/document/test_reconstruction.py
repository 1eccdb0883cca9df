"""Cameras of other programs: each format's own projection and ours meet at the same pixel."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshlab_svbrdf.document.project import new_project, write_project
from meshlab_svbrdf.document.reconstruction import read_reconstruction
from meshlab_svbrdf.errors import DocumentError
from meshlab_svbrdf.geometry.camera import Camera

POSE = Rotation.from_rotvec([0.3, -0.5, 0.2])
T = np.array([0.2, -0.1, 5.0])
POINTS = np.random.default_rng(8).uniform(-0.8, 0.8, (20, 3))
SIZE = 640, 480


def seen(foreign, points=POINTS):
    """The filmed pixels, centres at whole numbers, by what the reader gave."""
    p = points @ foreign.R.T + foreign.t
    return foreign.lens.distort(p[:, :2] / p[:, 2:])


def straight(foreign, points=POINTS):
    """The same, through the camera of the undistorted frame."""
    return foreign.pinhole().project(points)[:, :2]


def agrees(foreign, pixels, points=POINTS):
    np.testing.assert_allclose(seen(foreign, points), pixels, rtol=0, atol=1e-8)
    undistorted = foreign.lens.undistort_points(pixels)
    np.testing.assert_allclose(straight(foreign, points), undistorted, rtol=0, atol=1e-6)


# COLMAP

MODELS = {
    "SIMPLE_PINHOLE": (500.0, 318.0, 241.0),
    "PINHOLE": (500.0, 510.0, 318.0, 241.0),
    "SIMPLE_RADIAL": (500.0, 318.0, 241.0, -0.1),
    "RADIAL": (500.0, 318.0, 241.0, -0.1, 0.02),
    "OPENCV": (500.0, 510.0, 318.0, 241.0, -0.1, 0.02, 0.001, -0.002),
    "FULL_OPENCV": (500.0, 510.0, 318.0, 241.0, -0.1, 0.02, 0.001, -0.002, 0.003, 0, 0, 0),
}
NUMBERS = {name: k for k, name in enumerate(
    ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
     "FULL_OPENCV"]
)}  # fmt: skip


def colmap_pixels(model, values):
    """As COLMAP's camera models define it: pixel centres at halves."""
    x, y, z = (POINTS @ POSE.as_matrix().T + T).T
    u, v = x / z, y / z
    simple = model.startswith("SIMPLE") or model == "RADIAL"
    fx, fy = (values[0], values[0]) if simple else values[:2]
    cx, cy = values[1:3] if simple else values[2:4]
    k = [*values[3 if simple else 4 :], 0, 0, 0, 0, 0][:5]
    k1, k2, p1, p2, k3 = (k[0], k[1], 0, 0, 0) if simple else k
    r2 = u * u + v * v
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    du = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
    dv = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v)
    return np.c_[fx * (u + du) + cx, fy * (v + dv) + cy]


def quaternion():
    x, y, z, w = POSE.as_quat()
    return w, x, y, z


def colmap_text(folder: Path, model: str, values) -> Path:
    folder.mkdir(exist_ok=True)
    words = " ".join(map(repr, map(float, values)))
    (folder / "cameras.txt").write_text(f"# Camera list\n3 {model} 640 480 {words}\n")
    pose = " ".join(map(repr, map(float, [*quaternion(), *T])))
    (folder / "images.txt").write_text(
        f"# Image list\n1 {pose} 3 walk/b 2.jpg\n1.5 2.5 -1\n2 {pose} 3 a.jpg\n\n"
    )
    (folder / "points3D.txt").write_text("# 3D\n7 1.0 2.0 3.0 0 0 0 0.5 1 0\n")
    return folder


def colmap_binary(folder: Path, model: str, values) -> Path:
    folder.mkdir(exist_ok=True)
    camera = struct.pack("<QIiQQ", 1, 3, NUMBERS[model], *SIZE)
    (folder / "cameras.bin").write_bytes(camera + struct.pack(f"<{len(values)}d", *values))
    images = struct.pack("<Q", 2)
    for number, name, points in ((1, b"walk/b 2.jpg", 2), (2, b"a.jpg", 0)):
        images += struct.pack("<I7dI", number, *quaternion(), *T, 3) + name + b"\0"
        images += struct.pack("<Q", points) + struct.pack("<ddq", 1.5, 2.5, -1) * points
    (folder / "images.bin").write_bytes(images)
    point = struct.pack("<QQ3d3BdQII", 1, 7, 1.0, 2.0, 3.0, 0, 0, 0, 0.5, 1, 1, 0)
    (folder / "points3D.bin").write_bytes(point)
    return folder


@pytest.mark.parametrize("write", [colmap_text, colmap_binary])
@pytest.mark.parametrize("model", MODELS)
def test_colmap(tmp_path, write, model):
    found = read_reconstruction(write(tmp_path / "sparse", model, MODELS[model]))
    assert [camera.name for camera in found.cameras] == ["a.jpg", "walk/b 2.jpg"]
    np.testing.assert_array_equal(found.points, [[1, 2, 3]])
    for camera in found.cameras:
        agrees(camera, colmap_pixels(model, MODELS[model]) - 0.5)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_model_that_is_cut_off_anywhere_is_named(tmp_path, name):
    folder = colmap_binary(tmp_path / "m", "OPENCV", MODELS["OPENCV"])
    whole = (folder / name).read_bytes()
    for length in range(0, len(whole), 5):
        (folder / name).write_bytes(whole[:length])
        with pytest.raises(DocumentError, match=rf"{name}.*(cut off|file name)"):
            read_reconstruction(folder)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("cameras.txt", "3 PINHOLE 640 480 500 510 318", r"line 1: PINHOLE has 4 parameters, 3"),
        ("cameras.txt", "\n3 OPENCV_FISHEYE 640 480 1 2 3 4 5 6 7 8", "line 2.*image_undistorter"),
        ("cameras.txt", "3 MINE 640 480 1", "unknown camera model 'MINE'"),
        ("cameras.txt", "3 PINHOLE 640 wide 1 2 3 4", "line 1: expected CAMERA_ID"),
        ("cameras.txt", "3 PINHOLE 640 480 -1 2 3 4", "focal length is -1"),
        ("cameras.txt", "3 PINHOLE 640 480 nan 2 3 4", "finite numbers"),
        ("cameras.txt", "3 SIMPLE_RADIAL 640 480 300 320 240 -9", "fold the frame"),
        ("cameras.txt", "4 PINHOLE 640 480 500 510 318 241", "camera 3 is not in cameras.txt"),
        ("images.txt", "1 1 0 0 0 0 0 0", "line 1: expected IMAGE_ID"),
        ("images.txt", "1 1 1 0 0 0 0 0 3 a.jpg\n\n", "unit quaternion"),
        ("images.txt", "1 1 0 0 0 0 inf 0 3 a.jpg\n\n", "pose is not finite"),
        ("images.txt", "# nothing\n", "no registered camera"),
        ("points3D.txt", "1 2 3\n", "line 1: expected POINT3D_ID"),
    ],
)  # fmt: skip
def test_damaged_text_models_are_named(tmp_path, name, text, says):
    folder = colmap_text(tmp_path / "m", "PINHOLE", MODELS["PINHOLE"])
    (folder / name).write_text(text)
    with pytest.raises(DocumentError, match=says):
        read_reconstruction(folder)


def test_counts_beyond_the_file_do_not_fill_the_memory(tmp_path):
    folder = colmap_binary(tmp_path / "m", "PINHOLE", MODELS["PINHOLE"])
    (folder / "images.bin").write_bytes(struct.pack("<Q", 2**63) + b"\0" * 100)
    with pytest.raises(DocumentError, match=r"cut off|not in cameras"):
        read_reconstruction(folder)


# Bundler

F, K1, K2 = 700.0, -0.08, 0.01
FLIP = np.diag([1.0, -1.0, -1.0])


def bundler(folder: Path, names="a.jpg\nb.jpg 0 700\n") -> Path:
    R, t = FLIP @ POSE.as_matrix(), FLIP @ T
    rows = "\n".join(" ".join(map(repr, row.tolist())) for row in [*R, t])
    text = f"# Bundle file v0.3\n2 1\n{F} {K1} {K2}\n{rows}\n0 0 0\n{'0 0 0' + chr(10)}" + (
        "0 0 0\n0 0 0\n0 0 0\n1.0 2.0 3.0\n255 0 0\n1 0 5 10.5 -3.5\n"
    )
    (folder / "list.txt").write_text(names)
    (folder / "bundle.out").write_text(text)
    return folder / "bundle.out"


def test_bundler(tmp_path):
    found = read_reconstruction(bundler(tmp_path), lambda name: SIZE)
    assert [camera.name for camera in found.cameras] == ["a.jpg"]
    np.testing.assert_array_equal(found.points, [[1, 2, 3]])
    # As Bundler's manual defines it: from the middle, upwards
    P = POINTS @ (FLIP @ POSE.as_matrix()).T + FLIP @ T
    p = -P[:, :2] / P[:, 2:]
    r2 = (p**2).sum(1, keepdims=True)
    x, y = (F * (1 + K1 * r2 + K2 * r2**2) * p).T
    agrees(found.cameras[0], np.c_[x + 320 - 0.5, 240 - y - 0.5])


def test_damaged_bundles_are_named(tmp_path):
    path = bundler(tmp_path)
    with pytest.raises(DocumentError, match=r"camera 0 \(a.jpg\): its image is not among"):
        read_reconstruction(path)
    whole = path.read_text()
    for words in range(2, len(whole.split())):
        path.write_text("# Bundle file v0.3\n" + " ".join(whole.split()[4 : 4 + words - 2]))
        with pytest.raises(DocumentError, match=r"bundle\.out.*cut off"):
            read_reconstruction(path, lambda name: SIZE)
        if words > 30:
            break
    path.write_text(whole.replace("v0.3\n2 1", "v0.3\n2 x"))
    with pytest.raises(DocumentError, match="expected 2 numbers"):
        read_reconstruction(path, lambda name: SIZE)
    for count in ("nan", "inf", "-1", "1.5", "1e300"):
        path.write_text(whole.replace("v0.3\n2 1", f"v0.3\n2 {count}"))
        with pytest.raises(DocumentError, match="line 2: expected a count, found"):
            read_reconstruction(path, lambda name: SIZE)
        path.write_text(whole.replace("255 0 0\n1 0 5", f"255 0 0\n{count} 0 5"))
        with pytest.raises(DocumentError, match="point 0: expected a count, found"):
            read_reconstruction(path, lambda name: SIZE)
    path.write_text("hello\n")
    with pytest.raises(DocumentError, match="line 1: expected '# Bundle file"):
        read_reconstruction(path, lambda name: SIZE)
    path = bundler(tmp_path, "a.jpg\n")
    with pytest.raises(DocumentError, match="names 1 images"):
        read_reconstruction(path, lambda name: SIZE)
    (tmp_path / "list.txt").unlink()
    with pytest.raises(DocumentError, match=r"list\.txt"):
        read_reconstruction(path, lambda name: SIZE)


# Metashape

CALIBRATION = (
    '<resolution width="640" height="480"/><f>500</f><b1>4</b1><cx>-3.5</cx><cy>2.25</cy>'
    "<k1>-0.1</k1><k2>0.02</k2><k3>0.003</k3><p1>0.001</p1><p2>-0.002</p2>"
)
CHUNK = (
    "<transform><rotation>{R}</rotation><translation>1 2 3</translation><scale>2.5</scale>"
    "</transform>"
)
TURN = Rotation.from_rotvec([0.1, 0.2, -0.4]).as_matrix()


def numbers(array) -> str:
    return " ".join(map(repr, np.ravel(array).tolist()))


def metashape(path: Path, *, calibration=CALIBRATION, sensor="frame", transform=None) -> Path:
    matrix = np.eye(4)
    matrix[:3, :3] = POSE.as_matrix().T
    matrix[:3, 3] = -POSE.as_matrix().T @ T
    transform = numbers(matrix) if transform is None else transform
    path.write_text(
        '<?xml version="1.0"?><document version="1.4.0"><chunk>'
        f'<sensors><sensor id="0" type="{sensor}"><calibration type="frame" class="initial">'
        '<resolution width="640" height="480"/><f>1</f></calibration>'
        f'<calibration type="frame" class="adjusted">{calibration}</calibration></sensor></sensors>'
        '<cameras><group><camera id="0" label="a" sensor_id="0"><transform>'
        f"{transform}</transform></camera></group>"
        '<camera id="1" label="lost" sensor_id="0"/>'
        '<camera id="2" label="off" sensor_id="0" enabled="0"><transform>1</transform></camera>'
        f"</cameras>{CHUNK.format(R=numbers(TURN))}</chunk></document>"
    )
    return path


def test_metashape(tmp_path):
    (camera,) = read_reconstruction(metashape(tmp_path / "cameras.xml")).cameras
    assert camera.name == "a"
    # As Metashape's manual, appendix C, defines it, of points in the chunk
    X, Y, Z = (POINTS @ POSE.as_matrix().T + T).T
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    radial = 1 - 0.1 * r2 + 0.02 * r2**2 + 0.003 * r2**3
    P1, P2 = 0.001, -0.002
    dx = x * radial + P1 * (r2 + 2 * x * x) + 2 * P2 * x * y
    dy = y * radial + P2 * (r2 + 2 * y * y) + 2 * P1 * x * y
    pixels = np.c_[640 / 2 - 3.5 + dx * 500 + dx * 4, 480 / 2 + 2.25 + dy * 500] - 0.5
    world = 2.5 * POINTS @ TURN.T + [1, 2, 3]
    agrees(camera, pixels, world)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"transform": "1 2 3"}, r"camera 'a': <transform>: expected 16 numbers"),
        ({"transform": "nan " * 16}, "expected 16 numbers"),
        ({"transform": "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1"}, "expected a rotation"),
        ({"sensor": "fisheye"}, "type 'fisheye', expected frame"),
        ({"calibration": CALIBRATION + "<k4>0.1</k4>"}, "k4"),
        ({"calibration": CALIBRATION + "<b2>3</b2>"}, "b2"),
        ({"calibration": CALIBRATION.replace("<f>500</f>", "<f>wide</f>")}, "<f>: expected 1"),
        ({"calibration": CALIBRATION.replace("<f>500</f>", "")}, "has no fx"),
    ],
)
def test_damaged_metashape_files_are_named(tmp_path, change, says):
    with pytest.raises(DocumentError, match=says):
        read_reconstruction(metashape(tmp_path / "cameras.xml", **change))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<document><chunk>", "not well-formed"),
        ("<MeshLabProject/>", "expected Metashape's <document>"),
        ('<!DOCTYPE d [<!ENTITY a "b">]><document><chunk/></document>', "XML entity 'a'"),
        ("<document><chunk/></document>", "no registered camera"),
    ],
)
def test_other_xml_is_refused(tmp_path, text, says):
    path = tmp_path / "cameras.xml"
    path.write_text(text)
    with pytest.raises(DocumentError, match=says):
        read_reconstruction(path)


# Ours

CAMERA = Camera(640, 480, 500.0, 510.0, 317.5, 240.5, POSE.as_matrix(), T)


def entry(**change):
    K = CAMERA.K.tolist()
    return {"image": "a.jpg", "width": 640, "height": 480, "K": K, "R": CAMERA.R.tolist(),
            "t": T.tolist()} | change  # fmt: skip


def test_cameras_json_and_projects(tmp_path):
    path = tmp_path / "cameras.json"
    for name in ("cameras", "frames", "views"):
        path.write_text(json.dumps({name: [entry(distortion=[-0.1, 0.02])]}))
        (camera,) = read_reconstruction(path).cameras
        assert camera.lens.coefficients == (-0.1, 0.02, 0, 0, 0)
        agrees(camera, seen(camera))
    project = new_project()
    project.add_raster("one", tmp_path / "f 1.png", CAMERA)
    write_project(project, tmp_path / "p.mlp")
    (camera,) = read_reconstruction(tmp_path / "p.mlp").cameras
    assert camera.name == "f 1.png"
    agrees(camera, CAMERA.project(POINTS)[:, :2])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[1, 2]", r'expected {"cameras"'),
        ("{", "is no JSON"),
        (json.dumps({"cameras": [entry(R=[[1, 2], [3, 4]])]}), r"cameras\[0\]: expected image"),
        (json.dumps({"cameras": [entry(), entry(t=[1])]}), r"cameras\[1\]"),
        (json.dumps({"cameras": [entry(K=[[1, 2, 3]] * 3)]}), "without skew"),
        (json.dumps({"cameras": [{"image": "a"}]}), "KeyError"),
        (json.dumps({"cameras": [5]}), r"cameras\[0\]"),
        (json.dumps({"cameras": []}), "no registered camera"),
    ],
)
def test_damaged_json_is_named(tmp_path, content, says):
    path = tmp_path / "cameras.json"
    path.write_text(content)
    with pytest.raises(DocumentError, match=says):
        read_reconstruction(path)


def test_what_is_no_camera_file_is_refused(tmp_path):
    for path, says in (
        (tmp_path, "folder of a COLMAP model"),
        (tmp_path / "none.out", "does not exist"),
        (tmp_path / "x.txt", r"expected a COLMAP folder.*\.out"),
    ):
        if path.suffix == ".txt":
            path.write_text("")
        with pytest.raises(DocumentError, match=says):
            read_reconstruction(path)
    (tmp_path / "b.out").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DocumentError, match="cannot be read as text"):
        read_reconstruction(tmp_path / "b.out")
