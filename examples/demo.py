"""The whole chain on a real stereo pair, and on a walk: photos in, .tsplat out, pictures back (`make demo`).

    python examples/demo.py --out demo_out
    python examples/demo.py --out demo_out --photos     # the photos alone, as two scene folders

The photos are the calibrated Middlebury motorcycle pair that scikit-image's wheel carries, and a made-up room's;
nothing is fetched.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat.measure.metrics import psnr
from tinysplat.measure.pictures import mean_psnr
from tinysplat.measure.show.tables import format_table
from tinysplat.measure.subjects.captures import Capture
from tinysplat.measure.subjects.room import FAR_M, NEAR_M, write_motorcycle, write_room
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.render.video import write_video
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.system.progress import working
from tinysplat_runtime.system.stopwatch import Stopwatch

INVERSE_DEPTH_COLORS = np.array([[13, 8, 60], [70, 20, 140], [190, 55, 110], [248, 140, 60], [252, 250, 190]]) / 255

WALK_PHOTOS, WALK_SIDE = 20, 192
"""Photos along a room, every fourth of which is left out (`Capture`), and their side."""

WALKED_SIDE = 144
"""What the demo makes of it, to be done within a minute."""

PAIR_FRAMES, WALK_FRAMES = 12, 40
"""Of the films."""

ZOOM = 3
"""How much larger than the photos the scene is drawn to look at it from close by."""


def depth_picture(depth: NDArray) -> NDArray:
    """(H, W) z depth of the pair to colours: near is bright."""
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    share = np.clip((inverse - 1 / FAR_M) / (1 / NEAR_M - 1 / FAR_M), 0, 1)
    stops = np.linspace(0, 1, len(INVERSE_DEPTH_COLORS))
    return np.stack([np.interp(share, stops, INVERSE_DEPTH_COLORS[:, c]) for c in range(3)], axis=-1)


def closer(renderer: Renderer, camera: ts.Camera) -> NDArray:
    """A quarter of the picture, its pixels enlarged, beside the same drawn `ZOOM` times as large: (h, w, 3)."""
    height, width = camera.height, camera.width
    native = renderer.render(camera)
    drawn = renderer.render(camera.resized(ZOOM * height, ZOOM * width))
    enlarged = native.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
    rows, columns = [slice(ZOOM * (n // 4), ZOOM * (n // 4 + n // 2)) for n in (height, width)]
    return np.concatenate([picture[rows, columns] for picture in (enlarged, drawn)], axis=1)


def run(scene: ts.Scene, profile: str, out: Path, runtime: ts.Runtime) -> dict[str, str]:
    """Encode, decode and render one scene; write its pictures; return its row of the table."""
    watch = Stopwatch()
    gaussians = runtime.predict(scene, watch=watch)
    data = runtime.compress(gaussians, profile, stats=EncodeStats(watch=watch))
    height, width = gaussians.opacities.shape[1:]
    name = f"motorcycle_{width}x{height}_{profile}"
    (out / f"{name}.tsplat").write_bytes(data)

    decoded = runtime.decompress(data, watch=watch)
    raw_renderer, renderer = Renderer(gaussians), Renderer(decoded)
    photos, to_photo, to_raw = scene.images(), [], []
    for view, camera in enumerate(scene.cameras):
        raw = raw_renderer.render(camera)
        with watch.stage("render"):
            pictures = renderer.render(camera, outputs=("rgb", "depth"))
        to_photo.append(psnr(raw, photos[view]))
        to_raw.append(psnr(pictures["rgb"], raw))
        row = np.concatenate([photos[view], raw, pictures["rgb"], depth_picture(pictures["depth"])], axis=1)
        write_png(out / f"{name}_view{view}.png", row)
    write_png(out / f"{name}_closer.png", closer(renderer, scene.cameras[0]))
    write_video(out / f"{name}.mp4", (renderer.render(c) for c in between(scene.cameras, PAIR_FRAMES)))
    raw_bytes = sum(getattr(layer, field).nbytes for layer in gaussians.layers for field in FIELDS)
    return {
        "size": f"{width}x{height}",
        "profile": profile,
        "KB": f"{len(data) / 1000:.1f}",
        "of raw": f"1/{raw_bytes / len(data):.0f}",
        "raw-photo dB": f"{np.mean(to_photo):.2f}",
        "decoded-raw dB": f"{np.mean(to_raw):.2f}",
        **{f"{stage} s": f"{seconds:.3f}" for stage, seconds in watch.seconds.items()},
    }


def walk(out: Path, runtime: ts.Runtime) -> str:
    """A walk through a made-up room: photos along it to one list and its page, photos left out drawn from it; what came
    of it.
    """
    folder = out / "room"
    write_room(folder, WALK_PHOTOS, WALK_SIDE, WALK_SIDE)
    capture, watch = Capture.of(ts.load_scene(folder).resized(WALKED_SIDE, WALKED_SIDE)), Stopwatch()
    with watch.stage("encode"):
        data = runtime.encode(capture.others, mode="list")
    (out / "walk.tsplat").write_bytes(data)
    page = ["view", str(out / "walk.tsplat"), "--html", str(out / "walk.html"), "-q", "--force"]
    subprocess.run([sys.executable, "-m", "tinysplat_runtime", *page], check=True)
    renderer = Renderer(runtime.decompress(data))
    photos, drawn = capture.targets.images(), list(map(renderer.render, capture.targets.cameras))
    write_png(out / "walk.png", np.concatenate([np.concatenate(list(row), axis=1) for row in (photos, drawn)]))
    write_video(out / "walk.mp4", map(renderer.render, between(capture.others.cameras, WALK_FRAMES)))
    found, given = mean_psnr(drawn, photos), len(capture.others.frames)
    size = f"a walk, {given} photos of {WALKED_SIDE}x{WALKED_SIDE} as one list: {len(data) / 1000:.0f} KB"
    return (
        f"{size} in {watch.seconds['encode']:.1f} s; photos left out are drawn at {found:.1f} dB: {out / 'walk.html'}"
    )


def main() -> int:
    """Run the demo; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("demo_out"))
    parser.add_argument("--photos", action="store_true", help="write the photos and their cameras alone")
    args = parser.parse_args()
    out: Path = args.out
    folder = out / "motorcycle"
    try:
        write_motorcycle(folder, 500, 741)
    except ts.InputError as error:
        print(error, file=sys.stderr)
        return 2
    if args.photos:
        write_room(out / "room", WALK_PHOTOS, WALK_SIDE, WALK_SIDE)
        print(f"{folder}: 2 photos and their cameras\n{out / 'room'}: {WALK_PHOTOS} photos and their cameras")
        return 0
    full, runtime = ts.load_scene(folder), ts.Runtime()
    print("a pair at two sizes, then a walk: about a minute of one core, a quarter of it to compile, once", flush=True)
    rows = []
    for scene in (full.resized(256, 256), full):
        with working(f"photos of {scene.cameras[0].width}x{scene.cameras[0].height}", quiet=False):
            rows.append(run(scene, "balanced", out, runtime))
    walked = walk(out, ts.Runtime(told=ts.Voice()))
    print(format_table([*rows[0]], [[*row.values()] for row in rows]))
    print(f"\n{walked}")
    print(f"\npictures (photo | raw render | decoded render | depth), videos and files: {out}/")
    return 0


if __name__ == "__main__":
    sys.exit(main())
