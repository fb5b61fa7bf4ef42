"""OpenSplat beside `tinysplat bench walk`: the same photos given and left out, the same cameras, the same judges.

    python checks/opensplat.py OPENSPLAT SCENE… --steps 300,1000 --out rows.jsonl

OPENSPLAT is the program of your own build (AGPL-3.0; nothing of it is here), SCENE a capture as `bench walk` takes it.
It trains on the CPU from 24 photos of 256×256, their cameras, and corners that three of them agree on. As shipped,
its schedule is one of 30,000 steps, and a short run never gets to detail; here it is fitted to the steps: photos of 64
and 128 pixels for a fifth of them each, more Gaussians at two, three and four tenths, one degree of colour more every
quarter (not with `--shipped`). What it has written is drawn at the photos left out as 3DGS defines, by our renderer.
Rows come of the way `OpenSplat`, as of `walk` or, with `--study rates`, beside `bench rates` of the same photos; tables
of both know it. Seconds are its process's, user and system.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat.measure.clock import cpu_of
from tinysplat.measure.pictures import to_photos
from tinysplat.measure.rows import TRAINER, Row
from tinysplat.measure.studies.rates import STUDY as RATES
from tinysplat.measure.studies.walking import COMPARED, STUDY
from tinysplat.measure.subjects.captures import Capture, found_for
from tinysplat.measure.subjects.corners import agreed_corners
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.pictures import write_png

SIDE = 256


def corner_points(scene: ts.Scene) -> tuple[NDArray, NDArray]:
    """World places (N, 3) of corners whose depth three photos agree on, and their colours (N, 3) uint8."""
    places, colours = [], []
    for frame, (pixels, inverse) in zip(scene.frames, agreed_corners(scene), strict=True):
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(frame.camera.K).T
        places.append(rays / inverse[:, None] @ frame.camera.rotation + frame.camera.centre)
        column, row = pixels.astype(int).T
        colours.append((255 * frame.image()[row, column]).round().astype(np.uint8))
    return np.concatenate(places), np.concatenate(colours)


def write_project(folder: Path, scene: ts.Scene) -> None:
    """A nerfstudio folder of a scene with its points."""
    points, colours = corner_points(scene)
    lines = [" ".join(map(str, [*place, *colour])) for place, colour in zip(points, colours, strict=True)]
    kinds = [*(f"property float {axis}" for axis in "xyz"), *(f"property uchar {c}" for c in ("red", "green", "blue"))]
    header = ["ply", "format ascii 1.0", f"element vertex {len(lines)}", *kinds, "end_header"]
    (folder / "points.ply").write_text("\n".join([*header, *lines]) + "\n")
    frames = []
    for number, frame in enumerate(scene.frames):
        name, image = f"{number:04}.png", frame.image()
        write_png(folder / name, image)
        camera = np.linalg.inv(frame.camera.w2c) @ np.diag([1, -1, -1, 1])  # y up, looking along -z
        (fx, _, cx), (_, fy, cy), _ = frame.camera.K.tolist()
        (height, width), lens = image.shape[:2], {"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
        frames.append({"file_path": name, "w": width, "h": height, **lens, "transform_matrix": camera.tolist()})
    document = {"camera_model": "OPENCV", "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document))


def trained(program: Path, project: Path, steps: int, shipped: bool) -> tuple[ts.Gaussians, float, int]:
    """What it makes of a project: Gaussians, processor seconds, and the bytes of its `.ply`."""
    made, tenth = project / f"{steps}.ply", str(steps // 10)
    fitted = {
        "num-downscales": "2",
        "resolution-schedule": str(steps // 5),
        "sh-degree-interval": str(steps // 4),
        "warmup-length": tenth,
        "refine-every": tenth,
    }
    schedule = {"num-iters": str(steps)} | ({} if shipped else fitted)
    options = [word for name, value in schedule.items() for word in (f"--{name}", value)]
    command = [program, project, "--output", made, "--cpu", "--keep-crs", *options]
    _, cpu = cpu_of(lambda: subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL))
    return ts.load_gaussians(made), cpu, made.stat().st_size


def main(arguments: Sequence[str] | None = None) -> int:
    """Write a row per scene and number of steps, and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=Path, metavar="OPENSPLAT")
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--steps", default="1000", help="numbers of steps, with commas between")
    parser.add_argument("--shipped", action="store_true", help="keep its own schedule but for the number of steps")
    parser.add_argument("--study", choices=(STUDY, RATES), default=STUDY, help="whose tables the rows are for")
    parser.add_argument("--version", required=True, help="of OPENSPLAT, and what was mended in it; goes into the rows")
    parser.add_argument("--out", type=Path, required=True, metavar="ROWS")
    given = parser.parse_args(arguments)
    for path in given.scenes:
        capture = Capture.of(ts.load_scene(path)).resized((SIDE, SIDE), (SIDE, SIDE))
        scene = found_for(capture.given(COMPARED))
        with tempfile.TemporaryDirectory() as folder:
            write_project(Path(folder), scene)
            for steps in map(int, given.steps.split(",")):
                gaussians, cpu, size = trained(given.program, Path(folder), steps, given.shipped)
                draw = Renderer(gaussians, **DEFINITION).render
                figures = to_photos(map(draw, capture.targets.cameras), capture.targets)
                setting = {"photos": len(scene.frames), "asked": str(COMPARED), "steps": steps, "by": given.version}
                setting |= {"schedule": "shipped"} if given.shipped else {}
                counts = {"gaussians": gaussians.count, "bytes": size}
                row = Row(given.study, path.name, TRAINER, setting, {**figures, **counts}, {"cpu": cpu})
                line = json.dumps(row.to_json(), ensure_ascii=False)
                print(line)
                with given.out.open("a", encoding="utf-8") as file:
                    file.write(line + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
