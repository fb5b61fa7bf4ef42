"""How many wrong cameras and photos are warned of, and how many right ones are.

Each fault is put into a pair and into four photos of each scene. A scene is a folder with cameras.json; of those with
an eval_index.json its windows are taken, of others photos beside each other. Right cameras are looked at in a window of
each kind and in twelve photos spread over the scene, whose range is found.

    python checks/wrong_cameras.py SCENES/* [--right]
"""

import argparse
import dataclasses
import json
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.doubts import KINDS
from tinysplat_runtime.recipe.doubts.seen import Seen
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.lenses import opencv_lens
from tinysplat_runtime.scene.scenes import Frame, Scene, even_sizes
from tinysplat_runtime.system.evenly import evenly
from tinysplat_runtime.system.told import NOBODY


def turned_about(c2w, axis, degrees):
    """A camera turned about one of its own axes."""
    (first, second), angle = ((1, 2), (2, 0), (0, 1))[axis], np.radians(degrees)
    turn = np.eye(4)
    turn[[first, first, second, second], [first, second, first, second]] = (
        *(np.cos(angle), -np.sin(angle)),
        *(np.sin(angle), np.cos(angle)),
    )
    return c2w @ turn


def moved(c2w, axis, by):
    """A camera moved along one of its own axes."""
    return c2w @ (np.eye(4) + by * np.eye(4)[:, axis, None] * np.eye(4)[3])


def mirrored(c2w):
    flip = np.diag([-1.0, 1, 1, 1])
    return flip @ c2w @ flip


def turned(image, K):
    """A photo and its K turned to the left, once."""
    width = image.shape[1]
    return np.rot90(image), np.array([[K[1, 1], 0, K[1, 2]], [0, K[0, 0], width - K[0, 2]], [0, 0, 1]])


def scaled(K, x, y):
    K = K.copy()
    K[0, 0], K[1, 1] = x * K[0, 0], y * K[1, 1]
    return K


def with_entries(K, entries):
    K = K.copy()
    for place, value in entries.items():
        K[place] = value
    return K


def bars(image, share=0.15):
    """A photo with black bars over its top and bottom."""
    covered, n = image.copy(), int(share * image.shape[0])
    covered[:n] = covered[-n:] = 0
    return covered


def boxed(image, share=0.8):
    """A photo made smaller, with black all around it."""
    height, width = (int(share * side) for side in image.shape[:2])
    out, small = np.zeros_like(image), Image.fromarray(np.ascontiguousarray(image)).resize((width, height))
    top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    out[top : top + height, left : left + width] = np.asarray(small)
    return out


def shifted(image, share=0.1):
    n = int(share * image.shape[1])
    return np.concatenate([image[:, n:], np.repeat(image[:, -1:], n, axis=1)], axis=1)


def bannered(image, share=0.12):
    """A photo with writing along its bottom, the same on all."""
    pattern = np.random.default_rng(0).integers(0, 2, (3, 24)).astype(np.uint8) * 200 + 30
    n, out = int(share * image.shape[0]), image.copy()
    out[-n:] = np.asarray(Image.fromarray(pattern).resize((image.shape[1], n), Image.Resampling.NEAREST))[..., None]
    return out


TURNS, FOCAL, ONE = ("turned", "rolled", "upside", "their side"), ("focal",), ("photo 2",)
BARS, ALL_BARS = ("photo 2 (1.png) has black bars",), ("all photos have black bars",)
NOISE = np.random.default_rng(0)
FAULTS = {  # each photo, K and pose, and what a line that names the cause says one of
    "world mirrored": (lambda i, K, p: (i, K, mirrored(p)), ("mirrored",)),
    "photos mirrored": (lambda i, K, p: (i[:, ::-1], K, p), ("mirrored",)),
    "photos and K turned by 90°": (lambda i, K, p: (*turned(i, K), p), TURNS),
    "photos and K turned by 270°": (lambda i, K, p: (*turned(*turned(*turned(i, K))), p), TURNS),
    "poses rolled by 90°": (lambda i, K, p: (i, K, turned_about(p, 2, 90)), TURNS),
    "poses rolled by 180°": (lambda i, K, p: (i, K, turned_about(p, 2, 180)), TURNS),
    "photos turned by 180°": (lambda i, K, p: (i[::-1, ::-1], K, p), TURNS),
    "focal length × 0.5": (lambda i, K, p: (i, scaled(K, 0.5, 0.5), p), FOCAL),
    "focal length × 2": (lambda i, K, p: (i, scaled(K, 2, 2), p), FOCAL),
    "focal length × 1.3": (lambda i, K, p: (i, scaled(K, 1.3, 1.3), p), FOCAL),
    "fx alone × 1.5": (lambda i, K, p: (i, scaled(K, 1.5, 1), p), ("fx",)),
    "cx and cy swapped": (lambda i, K, p: (i, with_entries(K, {(0, 2): K[1, 2], (1, 2): K[0, 2]}), p), ("principal",)),
    "cx and cy 10 % off": (
        lambda i, K, p: (i, with_entries(K, {(n, 2): K[n, 2] + i.shape[1 - n] / 10 for n in (0, 1)}), p),
        ("principal",),
    ),
    "skew of 20 px of 480": (lambda i, K, p: (i, with_entries(K, {(0, 1): 20 / 480 * i.shape[1]}), p), ("skew",)),
    "k1 of 50": (lambda i, K, p: (i, K, p), ("distortion",)),
    "one photo turned by 180°": (lambda i, K, p: (i[::-1, ::-1], K, p), ONE),
    "one photo mirrored": (lambda i, K, p: (i[:, ::-1], K, p), ONE),
    "one photo negative": (lambda i, K, p: (255 - i, K, p), ONE),
    "one pose rolled by 10°": (lambda i, K, p: (i, K, turned_about(p, 2, 10)), ONE),
    "one pose moved up by 0.3": (lambda i, K, p: (i, K, moved(p, 1, -0.3)), ONE),  # median depths are about 4
    "one pose moved aside by 0.3": (lambda i, K, p: (i, K, moved(p, 0, 0.3)), ONE),
    "one pose turned aside by 6°": (lambda i, K, p: (i, K, turned_about(p, 1, 6)), ONE),
    "one photo shifted by a tenth": (lambda i, K, p: (shifted(i), K, p), ONE),
    "one photo at 0.15 of its brightness": (
        lambda i, K, p: ((0.15 * i).astype(np.uint8), K, p),
        ("photo 2 (1.png) is much darker",),
    ),
    "one photo's red for blue": (lambda i, K, p: (i[..., ::-1], K, p), ("photo 2 (1.png) has its colours",)),
    "one photo with bars": (lambda i, K, p: (bars(i), K, p), BARS),
    "one photo made smaller in black": (lambda i, K, p: (boxed(i), K, p), BARS),
    "one photo of noise": (lambda i, K, p: (NOISE.integers(0, 255, i.shape, np.uint8), K, p), ONE),
    "photos with bars": (lambda i, K, p: (bars(i), K, p), ALL_BARS),
    "photos made smaller in black": (lambda i, K, p: (boxed(i), K, p), ALL_BARS),
    "banner over all photos": (lambda i, K, p: (bannered(i), K, p), ("one place of the picture",)),
}

RANGES = {  # factors of near and far, where these are stated
    "near a twentieth": (0.05, 1),
    "near and far × 0.1": (0.1, 0.1),
    "near and far × 10": (10, 10),
    "near and far × 1,000": (1000, 1000),
}


def windows(folder: Path, count: int) -> dict[str, list[int]]:
    """Photos to look at by kind and number, a pair and four of them in any case."""
    index, middle = folder / "eval_index.json", count // 2 - 2
    by_kind: dict[str, list[int]] = {}
    for window in json.loads(index.read_text())["windows"] if index.is_file() else ():
        by_kind.setdefault(f"{window['kind']} {len(window['context'])}", window["context"])
    return by_kind or {"near 2": [middle, middle + 1], "four 4": [*range(middle, middle + 4)]}


def with_fault(scene: Scene, images, fault, folder: Path, only: int | None, k1: float = 0.0) -> Scene:
    frames = []
    for v, (frame, image) in enumerate(zip(scene.frames, images, strict=True)):
        K, c2w = frame.camera.K, frame.camera.c2w
        if only is None or v == only:
            image, K, c2w = fault(image, K, c2w)
        path = folder / f"{v}.png"
        Image.fromarray(np.ascontiguousarray(image)).save(path, compress_level=1)
        if k1:
            lens = opencv_lens((K[0, 0], K[1, 1]), K[:2, 2], (k1, *7 * (0,)), image.shape[:2], fisheye=False)
            frames.append(Frame(lens.camera(c2w), path, lens=lens))
        else:
            frames.append(Frame(ts.Camera(K, c2w, image.shape[1], image.shape[0]), path))
    if k1:
        frames = even_sizes(frames)
    return dataclasses.replace(scene, frames=tuple(frames))


def found(scene: Scene, kinds: dict[str, list[int]]) -> list[str]:
    """What is said of a scene; `kinds` counts what each kind of evidence finds first, and what no other finds."""
    seen = Seen.of(scene, NOBODY)
    lines = {kind.__name__: said for kind in KINDS if (said := kind(seen))}
    for name in lines:
        kinds[name][0] += name == next(iter(lines))
        kinds[name][1] += len(lines) == 1
    return next(iter(lines.values()), [])


def look_at_right(folder: Path, scene: Scene, by_kind: dict[str, list[int]]) -> list[list[str]]:
    """What is said of a scene's own cameras, window by window."""
    sets = [(kind, scene.views(views)) for kind, views in by_kind.items()]
    if len(scene.frames) >= 12:
        sets.append(("spread 12", dataclasses.replace(scene.views(evenly(len(scene.frames), 12)), near=None, far=None)))
    said = []
    for kind, chosen in sets:
        try:
            said.append(found(prepared(EncodeRequest(chosen)), defaultdict(lambda: [0, 0])))
        except InputError as error:
            print(f"{folder.name} {kind}: refused, {error}")
            continue
        if said[-1]:
            print(f"alarm: {folder.name} {kind}: {said[-1][0]}", flush=True)
    return said


def look_at_wrong(folder: Path, window: Scene, size: str, faults: str, kinds: dict, tally: dict) -> None:
    """Put every fault whose name holds a word into a window; `tally` counts what is found, named, and tried."""
    images = [np.rint(255 * image).astype(np.uint8) for image in window.images()]
    for name, (fault, words) in FAULTS.items():
        if faults not in name or (size == "pair" and name.startswith(("one ", "banner"))):
            continue
        with tempfile.TemporaryDirectory() as place:
            only = 1 if name.startswith("one ") else None
            lines = found(with_fault(window, images, fault, Path(place), only, 50.0 * (name == "k1 of 50")), kinds)
        is_named = any(word in line for line in lines for word in words)
        tally[name, size] += bool(lines), is_named, 1
        if not is_named:
            print(f"{folder.name} {size} {name}: {lines[0] if lines else 'nothing'}", flush=True)
    for name, (nearer, farther) in RANGES.items() if not window.is_estimated else ():
        if faults in name:
            ranged = dataclasses.replace(window, near=nearer * window.near, far=farther * window.far)
            lines = found(ranged, kinds)
            is_named = any(word in line for line in lines for word in ("near", "units", "depth"))
            tally[name, size] += bool(lines), is_named, 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--right", action="store_true", help="right cameras only")
    parser.add_argument("--faults", default="", help="only those whose names hold this")
    options = parser.parse_args()
    tally, kinds, right = defaultdict(lambda: np.zeros(3, int)), defaultdict(lambda: [0, 0]), []
    for folder in options.scenes:
        scene = ts.load_scene(folder)
        by_kind = windows(folder, len(scene.frames))
        right += look_at_right(folder, scene, by_kind)
        for size, count in (("pair", 2), ("four", 4)) if not options.right else ():
            start = len(scene.frames) // 2 - 2
            views = next((views for views in by_kind.values() if len(views) == count), [*range(start, start + count)])
            window = scene.views(views)
            if window.near is None:
                window = prepared(EncodeRequest(window))
            look_at_wrong(folder, window, size, options.faults, kinds, tally)
    for (name, size), (seen, named, of) in tally.items():
        print(f"{name}, {size}: found {seen}, named {named} of {of}")
    if tally:
        print("all: found {}, named {} of {}".format(*sum(tally.values())))
    for name, (first, alone) in kinds.items():
        print(f"{name}: first to find {first}, alone {alone}")
    print(f"right cameras: {sum(map(bool, right))} of {len(right)} warned of")


if __name__ == "__main__":
    main()
