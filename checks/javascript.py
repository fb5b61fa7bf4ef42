"""The JavaScript decoder: types, size, package, and libde265 as a third opinion on planes.

    npm install typescript @types/node esbuild terser libheif-js    # in the folder this is run in; and node
    python checks/javascript.py [F.tsplat …]

Fails where `tsc --checkJs --strict` finds a fault, the decoder is larger than MOST_BYTES minified and gzipped, the
package that `npm pack` makes does not decode, or a picture of the files (by default the golden ones and the conformance
corpus) is decoded otherwise than libde265 does it.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "runtime")]

from conformance.run import CASES  # noqa: E402

import tinysplat_runtime as ts  # noqa: E402
from tinysplat_runtime.codec.free.planes import plane_shape  # noqa: E402
from tinysplat_runtime.container.photos import PHOTO_SIDE_MULTIPLE, Photos  # noqa: E402
from tinysplat_runtime.container.planes import Planes  # noqa: E402
from tinysplat_runtime.container.points import Points  # noqa: E402
from tinysplat_runtime.container.reader import read_container  # noqa: E402
from tinysplat_runtime.gaussian.planes import padded_size  # noqa: E402

WEB = Path(ts.__file__).parent / "web"
MOST_BYTES = 34_000
NPX = ["npx", "--no-install"]


def check_types() -> bool:
    """Strict types in JSDoc, and the same in tsplat.d.ts."""
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as name:
        same = Path(name) / "same.ts"
        modules = [str(path) for path in WEB.rglob("*.js") if "adapters" not in path.parts]
        (Path(name) / "declared.d.ts").write_text((WEB / "tsplat.d.ts").read_text())
        same.write_text(
            "import * as declared from './declared';\nimport { decode, decodeStream, inspect } from './typed.js';\n"
            "const a: typeof declared.decode = decode;\nconst b: typeof declared.decodeStream = decodeStream;\n"
            "const c: typeof declared.inspect = inspect;\nexport { a, b, c };\n"
        )
        (Path(name) / "typed.js").write_text((WEB / "tsplat.js").read_text().replace('"./', f'"{WEB}/'))
        options = {"extends": str(ROOT / "jsconfig.json"), "include": [], "files": [*modules, str(same)]}
        options["compilerOptions"] = {"strict": True}
        config = Path(name) / "tsconfig.json"
        config.write_text(json.dumps(options))
        done = subprocess.run([*NPX, "tsc", "-p", str(config)], capture_output=True, text=True, check=False)
    print("tsc:", done.stdout.strip() or "no fault")
    return done.returncode == 0


def check_size() -> bool:
    """Bytes of the bundle, minified by terser."""
    with tempfile.TemporaryDirectory() as name:
        bundle, small = Path(name) / "bundle.js", Path(name) / "small.js"
        flags = ["--bundle", "--format=esm", "--target=es2022", "--log-level=error", f"--outfile={bundle}"]
        subprocess.run([*NPX, "esbuild", str(WEB / "tsplat.js"), *flags], check=True)
        terser = ["--module", "--ecma", "2022", "-c", "passes=3", "-m", "-o", str(small)]
        subprocess.run([*NPX, "terser", str(bundle), *terser], check=True)
        size = len(gzip.compress(small.read_bytes(), 9))
        print(f"{len(small.read_bytes())} bytes minified, {size} gzipped")
    return size <= MOST_BYTES


def check_package() -> bool:
    """`npm pack`, and what it makes, installed elsewhere."""
    case = CASES / "balanced_layers" / "balanced_layers.tsplat"
    with tempfile.TemporaryDirectory() as name:
        packed = subprocess.run(
            ["npm", "pack", "--silent", "--pack-destination", name, str(WEB)],
            capture_output=True,
            text=True,
            check=True,
        )
        (Path(name) / "package.json").write_text('{"type": "module"}')
        archive = str(Path(name) / packed.stdout.split()[-1])
        subprocess.run(["npm", "install", "--silent", archive], cwd=name, check=True)
        script = "import { decode } from 'tsplat'; import { readFileSync } from 'node:fs';"
        script += f"console.log((await decode(readFileSync({str(case)!r}))).count)"
        done = subprocess.run(
            ["node", "--input-type=module", "-e", script], cwd=name, capture_output=True, text=True, check=False
        )
        print(
            f"npm pack: {Path(archive).stat().st_size} bytes,"
            f" decodes {done.stdout.strip()} Gaussians{done.stderr[-200:]}"
        )
    return done.stdout.strip() == str(ts.decompress(case.read_bytes()).count)


def pictures(data: bytes) -> Iterator[tuple[bytes, bytes, int, int, bool]]:
    """(parameter sets, slice, height, width, is a photo) of every picture of a file."""
    container = read_container(data)
    body, sets = container.body, container.parameter_sets
    if isinstance(body, Photos):
        header = body.photos
        size = [-(-side // PHOTO_SIDE_MULTIPLE) * PHOTO_SIDE_MULTIPLE for side in (header.height, header.width)]
        for stream in header.streams:
            yield sets[header.parameter_set], bytes(stream.checked(header.data, "")), size[0], size[1], True
    for index, channels in enumerate(container.pictures.channels):
        if isinstance(body, Points):
            height, width, number = *plane_shape(body.scene.tiers[index].count), index
        elif isinstance(body, Planes):
            layer = body.layers[index]
            height, width, number = layer.height, layer.width, layer.parameter_set
        for channel in channels:
            for view in range(len(channel.streams)):
                payload = bytes(container.pictures.payload(index, channel, view))
                yield sets[number], payload, *padded_size(height, width), False


def check_pictures(files: list[Path]) -> bool:
    """Every picture as libde265 decodes it."""
    with tempfile.TemporaryDirectory() as name:
        folder, listed = Path(name), list[dict[str, Any]]()
        for file in files:
            for sets, payload, height, width, is_photo in pictures(file.read_bytes()):
                entry = {"name": str(len(listed)), "width": width, "height": height}
                listed.append({**entry, "chroma": int(is_photo), "bits": 10 if is_photo else 12})
                (folder / f"{entry['name']}.sets").write_bytes(sets)
                (folder / f"{entry['name']}.picture").write_bytes(payload)
        (folder / "pictures.json").write_text(json.dumps(listed))
        subprocess.run(["node", str(ROOT / "tests" / "web" / "pictures.mjs"), name], check=True)
        subprocess.run(["node", str(Path(__file__).with_name("de265.mjs")), name], check=True)
        names = [entry["name"] for entry in listed]
        differ = [n for n in names if (folder / f"{n}.samples").read_bytes() != (folder / f"{n}.de265").read_bytes()]
        total = sum(np.fromfile(folder / f"{n}.samples", np.uint16).size for n in names)
        print(f"libde265: {len(names)} pictures of {len(files)} files, {total} samples, {len(differ)} differ")
    return not differ


def main(*files: str) -> int:
    """Run the check; returns the exit status."""
    given = [Path(file) for file in files]
    golden = sorted((ROOT / "tests" / "golden" / "data").glob("*.tsplat"))
    valid = [path for path in CASES.glob("*/*.tsplat") if (path.parent / "expected.npz").exists()]
    plain = [path for path in valid if "options" not in json.loads((path.parent / "case.json").read_text())]
    held = [check_types(), check_size(), check_package(), check_pictures(given or [*golden, *sorted(plain)])]
    return int(not all(held))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
