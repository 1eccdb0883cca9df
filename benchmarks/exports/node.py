"""Packages of JavaScript that judge and show glTF, installed into the cache on first use."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

PACKAGES = {"three": "0.187.0", "gltf-validator": "2.0.0-dev.3.10"}
VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs"), path = require("path");
const file = process.argv[1], folder = path.dirname(file);
const external = (uri) => Promise.resolve(new Uint8Array(fs.readFileSync(path.join(folder, uri))));
validator
  .validateBytes(new Uint8Array(fs.readFileSync(file)), { externalResourceFunction: external })
  .then((report) => console.log(JSON.stringify(report)));
"""


def modules(cache: Path) -> Path:
    """The folder node_modules that holds PACKAGES; OSError where npm cannot install them."""
    folder = cache / "node"
    found = folder / "node_modules"
    if not all(_version(found / name) == wanted for name, wanted in PACKAGES.items()):
        folder.mkdir(parents=True, exist_ok=True)
        names = [f"{name}@{wanted}" for name, wanted in PACKAGES.items()]
        command = ["npm", "install", "--no-audit", "--no-fund", "--prefix", str(folder), *names]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise OSError(f"npm could not install {' '.join(names)}: {done.stderr.strip()[-300:]}")
    return found


def why_not() -> str:
    """Why there is no Node.js here, or \"\"."""
    lacking = [word for word in ("node", "npm") if shutil.which(word) is None]
    return f"needs {' and '.join(lacking)} on the PATH" if lacking else ""


def validated(path: Path, modules: Path) -> dict[str, Any]:
    """The report of Khronos' validator on a .gltf or .glb."""
    done = subprocess.run(
        ["node", "-e", VALIDATE, str(path.absolute())],
        capture_output=True, text=True, check=True, cwd=modules.parent,
        env={"NODE_PATH": str(modules), "PATH": str(Path(shutil.which("node") or "").parent)},
    )  # fmt: skip
    return json.loads(done.stdout)


def _version(package: Path) -> str | None:
    told = package / "package.json"
    return json.loads(told.read_text())["version"] if told.is_file() else None


if __name__ == "__main__":
    print(modules(Path(sys.argv[1])).absolute())
