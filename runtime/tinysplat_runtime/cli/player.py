"""`tinysplat view --player --networks`: a folder with a player, networks, and onnxruntime-web to run them with.

onnxruntime-web (MIT) is an npm package that the user has: `npm install onnxruntime-web`. A browser takes two of its
files.
"""

from __future__ import annotations

import json
from pathlib import Path

from ..container.layout import MAX_FILE_BYTES
from ..errors import InputError
from ..graphs.artifacts import load_manifest
from ..graphs.enlarge import LARGE_PIXELS
from ..graphs.inference import GraphStore
from ..graphs.predict import NetworkLimits
from ..page.build import player_page
from ..system.files import read_limited, write_atomically

RUNTIME, WASM = "ort.wasm.bundle.min.mjs", "ort-wasm-simd-threaded.wasm"
PAGE = "index.html"


def write_player(folder: str, package: str) -> str:
    """Write the folder, which any web server can give.

    Returns:
        What was written, a line.

    Raises:
        InputError: `package` is not onnxruntime-web, or a file cannot be written.
        ModelError: a network is missing or damaged.
    """
    dist, target, store = Path(package) / "dist", Path(folder), GraphStore()
    _check_package(Path(package))
    files = {name: read_limited(dist / name, MAX_FILE_BYTES) for name in (RUNTIME, WASM)}
    models = {}
    for artifact in load_manifest().values():
        if artifact.role != "network":
            continue
        limits, file = NetworkLimits.of(store.network(artifact.name)), artifact.path.name
        models[artifact.sha256] = {"file": file, "stride": limits.stride, "minSide": limits.min_side}
        files[file] = read_limited(artifact.path, MAX_FILE_BYTES)
    networks = {"runtime": RUNTIME, "wasm": WASM, "most": LARGE_PIXELS, "models": models}
    files[PAGE] = player_page(networks).encode()
    target.mkdir(exist_ok=True)
    for name, data in files.items():
        write_atomically(target / name, data)
    return (
        f"{target / PAGE}: {sum(map(len, files.values())) / 1e6:.1f} MB in {len(files)} files, for a web server to give"
    )


def _check_package(package: Path) -> None:
    expected = "expected the folder of onnxruntime-web; `npm install onnxruntime-web` brings it"
    try:
        described = json.loads((package / "package.json").read_text("utf-8"))
    except (OSError, ValueError):
        raise InputError(f"no npm package, {expected}", where=str(package)) from None
    if not isinstance(described, dict) or described.get("name") != "onnxruntime-web":
        raise InputError(f"another npm package, {expected}", where=str(package))
