"""Files made to do harm, given to the shell: one error that names file and place, nothing changed.

Each case writes into a folder that holds a good project and its results, and gives the arguments of
a command and a part of what it must say.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

from typer.testing import CliRunner

from meshlab_svbrdf.cli import app
from meshlab_svbrdf.document.record import RECORD

from .files import formats
from .interruption import digests

Arguments = list[str]
LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
BOMB = f'<!DOCTYPE m [<!ENTITY l0 "lol">{LAUGHS}]>'
FILE = '<!DOCTYPE m [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
REMOTE = '<!DOCTYPE m [<!ENTITY % r SYSTEM "http://127.0.0.1:9/x.dtd"> %r;]>'
TEXELS = ["compute_svbrdf_texels", "texture_size=32"]


def try_handmade(folder: Path) -> list[tuple[str, str, str]]:
    """Every case: its name, what was said, and what broke ("" for nothing)."""
    good = folder / "good"
    formats(good)
    found = []
    for name, (make, says) in CASES.items():
        here = folder / "here"
        shutil.copytree(good, here, symlinks=True)
        arguments = make(here)
        before = digests(folder)
        answer = CliRunner().invoke(app, arguments)
        text = " ".join(answer.output.split())
        broke = ""
        if answer.exception is not None and not isinstance(answer.exception, SystemExit):
            broke = repr(answer.exception)[:200]
        elif answer.exit_code == 0 and says:
            broke = "was taken"
        elif says and answer.output.count("Error: ") != 1:
            broke = f"{answer.output.count('Error: ')} errors: {text[:200]}"
        elif says not in text:
            broke = f"said {text[:300]!r}, expected {says!r}"
        elif says and digests(folder) != before:
            broke = "files changed"
        elif not says and answer.exit_code:
            broke = f"refused: {text[:300]}"
        found.append((name, text, broke))
        shutil.rmtree(here)
    return found


# What cases are made of


def _edited(old: str, new: str, command: Arguments | None = None) -> Callable[[Path], Arguments]:
    """The project with some characters in place of others."""

    def make(folder: Path) -> Arguments:
        path = folder / "project" / "small.mlp"
        text = path.read_text()
        assert old in text, old
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return _on(path, command)

    return make


def _on(path: Path, command: Arguments | None = None) -> Arguments:
    output = str(path.parent / "out")
    if command is None:
        return ["apply", str(path), *TEXELS, "-o", output]
    return [command[0], str(path), *command[1:], *(["-o", output] if command[0] == "apply" else [])]


def _file(place: str, data: bytes | str, *command: str) -> Callable[[Path], Arguments]:
    """Other content of a file of the project; `{}` in the command stands for the folder."""

    def make(folder: Path) -> Arguments:
        path = folder / place
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        if command:
            return [word.replace("{}", str(folder)) for word in command]
        return _on(folder / "project" / "small.mlp")

    return make


def _cut(place: str, share: float, *command: str) -> Callable[[Path], Arguments]:
    def make(folder: Path) -> Arguments:
        data = (folder / place).read_bytes()
        return _file(place, data[: int(len(data) * share)], *command)(folder)

    return make


def _record(change: Callable[[dict], None], *command: str) -> Callable[[Path], Arguments]:
    """A changed record of results, and a command on it."""

    def make(folder: Path) -> Arguments:
        path = folder / "result" / "small.svbrdf" / RECORD
        record = json.loads(path.read_text())
        change(record)
        path.write_text(json.dumps(record))
        return [word.replace("{}", str(folder / "result")) for word in command] or [
            "info", str(folder / "result" / "small.mlp"),
        ]  # fmt: skip

    return make


def _linked(place: str, target: str) -> Callable[[Path], Arguments]:
    """A link in the results, to somewhere else."""

    def make(folder: Path) -> Arguments:
        path = folder / "result" / "small.svbrdf" / place
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        os.symlink(target.replace("{}", str(folder)), path)
        return ["apply", str(folder / "result" / "small.mlp"), *TEXELS]

    return make


def _own_file(record: dict) -> None:
    record["products"]["demo"]["files"].append("../../project/mesh.ply")


def _shown(record: dict) -> None:
    record["settings"]["shown"]["../../project/mesh.ply"] = "x"


def _itself(record: dict) -> None:
    record["products"]["demo"]["inputs"]["demo"] = record["products"]["demo"]["key"]


def _fifo(folder: Path) -> Arguments:
    os.mkfifo(folder / "pipe.mlp")
    return ["info", str(folder / "pipe.mlp")]


def _folder(folder: Path) -> Arguments:
    (folder / "folder.mlp").mkdir()
    return ["info", str(folder / "folder.mlp")]


def _elsewhere(folder: Path) -> Arguments:
    """A place where nobody may write."""
    return ["apply", str(folder / "project" / "small.mlp"), *TEXELS, "-o", "/proc/out"]


def _taken(folder: Path) -> Arguments:
    """A file where the folder of the output should be."""
    (folder / "out").write_text("mine")
    return ["apply", str(folder / "project" / "small.mlp"), *TEXELS, "-o", str(folder / "out")]


def _strange_names(folder: Path) -> Arguments:
    place = folder / "ä b 日本 'q' & <x> %s"
    (folder / "project").rename(place)
    return ["apply", str(place / "small.mlp"), *TEXELS, "-o", str(place / "öut put")]


def _strange_attributes(folder: Path) -> Arguments:
    """A mesh whose vertices have attributes that MeshLab's parser cannot take."""
    lines = ["ply", "format ascii 1.0", "element vertex 4", "property float x", "property float y",
             "property float z", "property float größe", "property float 1st-one",
             "property float x^2", f"property float {'long' * 60}", "element face 4",
             "property list uchar int vertex_indices", "property list uchar float texcoord",
             "end_header"]  # fmt: skip
    places = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    faces = ["0 2 1", "0 1 3", "0 3 2", "1 2 3"]
    uv = [".05 .05 .45 .05 .05 .45", ".55 .05 .95 .05 .55 .45", ".05 .55 .45 .55 .05 .95",
          ".55 .55 .95 .55 .55 .95"]  # fmt: skip
    lines += [f"{place} 1 2 3 4" for place in places]
    lines += [f"3 {face} 6 {corners}" for face, corners in zip(faces, uv, strict=True)]
    (folder / "project" / "mesh.ply").write_text("\n".join([*lines, ""]), encoding="utf-8")
    return _on(folder / "project" / "small.mlp")


def _png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(b"\0" * 1000)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", pixels), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _npy(shape: str) -> bytes:
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape},), }}".encode()
    header += b" " * (64 - (10 + len(header) + 1) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + b"\0" * 64


def _samples(folder: Path) -> Arguments:
    """All that projecting the frames needs, on a project whose frames were damaged."""
    path = folder / "project" / "small.mlp"
    script = folder / "samples.mlx"
    script.write_text(
        '<FilterScript><filter name="compute_svbrdf_texels"><Param name="texture_size" value="32"/>'
        '</filter><filter name="compute_svbrdf_samples"/></FilterScript>'
    )
    output = str(folder / "out")
    CliRunner().invoke(app, ["apply", str(path), *TEXELS, "-o", output])  # what is finished is kept
    return ["run", str(path), "-o", output, "--script", str(script)]


def _frame(data: Callable[[bytes], bytes]) -> Callable[[Path], Arguments]:
    def make(folder: Path) -> Arguments:
        frame = folder / "project" / "frames" / "f0.png"
        frame.write_bytes(data(frame.read_bytes()))
        return _samples(folder)

    return make


def _loop(folder: Path) -> Arguments:
    frame = folder / "project" / "frames" / "f0.png"
    frame.unlink()
    frame.symlink_to(frame)
    return _samples(folder)


def _device(folder: Path) -> Arguments:
    frame = folder / "project" / "frames" / "f0.png"
    frame.unlink()
    frame.symlink_to("/dev/zero")
    return _samples(folder)


PLY = "ply\nformat binary_little_endian 1.0\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
REGISTER = (
    "register", "{}/project/small.mlp", "-o", "{}/out", "--images", "{}/project/frames",
    "--cameras",
)  # fmt: skip
CASES: dict[str, tuple[Callable[[Path], Arguments], str]] = {
    "billion laughs, .mlp": (_edited("<!DOCTYPE MeshLabDocument>", BOMB), "XML entity 'l0'"),
    "an external entity, .mlp": (_edited("<!DOCTYPE MeshLabDocument>", FILE), "XML entity 'e'"),
    "a remote entity, .mlp": (_edited("<!DOCTYPE MeshLabDocument>", REMOTE), "XML entity 'r'"),
    "billion laughs, .mlx": (
        _file("chain.mlx", f"{BOMB}<FilterScript>&l9;</FilterScript>", "run",
              "{}/project/small.mlp", "-o", "{}/out", "--script", "{}/chain.mlx"),
        "XML entity 'l0'",
    ),
    "billion laughs, Metashape": (
        _file("metashape.xml", f"{BOMB}<document>&l9;</document>", *REGISTER, "{}/metashape.xml"),
        "XML entity 'l0'",
    ),
    "elements 10⁵ deep": (
        _edited("<MeshGroup>", "<MeshGroup>" + "<a>" * 100_000), "lies in 100 other elements",
    ),
    "a frame that is /etc/passwd": (
        lambda f: (_edited("frames/f0.png", "../" * 20 + "etc/passwd")(f), _samples(f))[1],
        "/etc/passwd is not an image",
    ),
    "a mesh that is /etc/passwd": (
        _edited("mesh.ply", "../" * 20 + "etc/passwd"), "/etc/passwd: expected a PLY or OBJ file",
    ),
    "a frame's file name of 5,000 letters": (
        _edited('fileName="frames/f0.png"', f'fileName="{"f" * 5000}.png"'), "that long name",
    ),
    "a camera 4·10⁹ pixels wide": (_edited('"32 24"', '"4000000000 24"'), "more pixels"),
    "a camera of 10²⁰ pixels": (_edited('"32 24"', f'"{10**20} 24"'), "expected 2 numbers"),
    "a camera that is nowhere": (
        _edited('TranslationVector="', 'TranslationVector="nan '), "TranslationVector: expected",
    ),
    "a rotation that is none": (
        _edited('RotationMatrix="1', 'RotationMatrix="2'), "not a rotation",
    ),
    "15 numbers of 16": (_edited('RotationMatrix="1.0 0.0', 'RotationMatrix="1.0'), "16 numbers"),
    "PLY of 10¹² vertices": (
        _file("project/mesh.ply", f"{PLY}element vertex 1000000000000\n{XYZ}end_header\n"),
        "mesh.ply: is cut off or damaged in its 1000000000000 vertex rows",
    ),
    "PLY of −1 vertices": (
        _file("project/mesh.ply", f"{PLY}element vertex -1\n{XYZ}end_header\n"), "malformed PLY",
    ),
    "PLY of 10¹² vertices without properties": (
        _file("project/mesh.ply", f"{PLY}element vertex 1000000000000\nend_header\n"), "mesh.ply",
    ),
    "PLY with a list of 2³² items": (
        _file("project/mesh.ply", f"{PLY}element vertex 1\n{XYZ}element face 1\nproperty list uint "
              "int vertex_indices\nend_header\n".encode().decode() + "\0" * 12 + "\x7f" * 4),
        "cut off or damaged in its 1 face rows",
    ),
    "a PLY cut off": (_cut("project/mesh.ply", 0.8), "mesh.ply: is cut off or damaged"),
    "an empty PLY": (_file("project/mesh.ply", b""), "mesh.ply: is not a PLY file"),
    "attributes that MeshLab's parser cannot take": (_strange_attributes, ""),
    "a frame cut off": (_frame(lambda data: data[: len(data) // 2]), "f0.png: the image is cut"),
    "a frame that is empty": (_frame(lambda data: b""), "f0.png is empty"),
    "a PNG of 60,000² pixels": (_frame(lambda data: _png_header(60_000, 60_000)), "f0.png"),
    "a PNG of 20,000² pixels": (_frame(lambda data: _png_header(20_000, 20_000)), "f0.png"),
    "a frame that links to itself": (_loop, "f0.png does not exist"),
    "a frame that is /dev/zero": (_device, "f0.png does not exist"),
    "NPY of 10¹² numbers": (
        _file("result/small.svbrdf/arrays/texels_center.npy", _npy("1000000000000"), "apply",
              "{}/result/small.mlp", "compute_svbrdf_visibility"), "texels_center.npy: holds more",
    ),
    "COLMAP of 2⁶³ cameras": (
        _file("colmap_binary/cameras.bin", b"\xff" * 8, *REGISTER, "{}/colmap_binary"),
        "cameras.bin: is cut off",
    ),
    "Bundler of 10¹⁸ cameras": (
        _file("bundle/bundle.out", f"# Bundle file v0.3\n{10**18} 1\n", *REGISTER,
              "{}/bundle/bundle.out"), "bundle",
    ),
    "JSON 10⁵ deep": (
        _file("cameras.json", "[" * 100_000, *REGISTER, "{}/cameras.json"), "is no JSON",
    ),
    "a video cut off": (
        _cut("film.mp4", 0.3, "register", "{}/project/small.mlp", "--video", "{}/film.mp4", "-o",
             "{}/out", "--start", "f0.png"), "film.mp4",
    ),
    "a record that owns a file elsewhere": (
        _record(_own_file), "'../../project/mesh.ply' does not lie in the folder of the results",
    ),
    "a record that shows a file elsewhere": (
        _record(_shown, "apply", "{}/small.mlp", *TEXELS), "does not lie in the folder",
    ),
    "a record of a result made from itself": (_record(_itself), "made from themselves: demo"),
    "results that link elsewhere": (_linked("maps", "{}/project"), "outside of the results"),
    "a result that links elsewhere": (
        _linked("layers/object.ply", "{}/project/mesh.ply"), "outside of the results",
    ),
    "a project that is a pipe": (_fifo, "pipe.mlp: is no file"),
    "a project that is a folder": (_folder, "folder.mlp: is no file"),
    "an output where nobody may write": (_elsewhere, "/proc/out"),
    "an output that is a file": (_taken, "out"),
    "blanks, quotes and other letters in all names": (_strange_names, ""),
}  # fmt: skip
