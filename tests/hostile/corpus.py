"""Small valid files of every kind that the product reads, made in code: what damage starts from."""

import json
import struct
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pillow_heif
from formats.foreign import glb_of_spz
from PIL import Image
from scene import trackers
from scenes import (
    colmap_texts,
    list_in_tiers,
    make_cameras,
    make_gaussians,
    make_list,
    make_photo,
    make_smooth_gaussians,
    scene_document,
    transforms_document,
    write_scene,
)

import tinysplat_runtime as ts
from tinysplat_runtime.graphs.artifacts import models_dir
from tinysplat_runtime.render.video import write_video
from tinysplat_runtime.scene.pictures import jpeg_bytes, png_bytes, write_png

from .containers import Seed


@lru_cache(maxsize=1)
def tsplat_seeds() -> tuple[Seed, ...]:
    """Files of 16×16 and less: both ways to code, one and two layers, one to three views, SH degree 0 to 2;
    one of exact planes, one with notes, and one of seven views."""
    cases = [
        (make_smooth_gaussians(1, 5, 7, 0), "paper"),
        (make_smooth_gaussians(2, 16, 16, 1), "paper"),
        (make_smooth_gaussians(2, 16, 16, 1, layers=2), "balanced"),
        (make_smooth_gaussians(1, 16, 16, 2), "fast"),
        (make_smooth_gaussians(3, 8, 12, 0), "balanced"),
    ]
    runtime = ts.Runtime(threads=1)
    cases.append((make_smooth_gaussians(7, 6, 8, 1, layers=2), "fast"))
    files = [runtime.compress(g, profile) for g, profile in cases]
    files.append(runtime.compress(make_smooth_gaussians(1, 6, 8, 0), lossless=True))
    noted = make_smooth_gaussians(1, 5, 7, 0).with_notes(ts.Notes("metre", "Jörg Müller", "CC-BY-4.0", "20 steps"))
    files.append(runtime.compress(noted, "paper"))
    return tuple(Seed.of(data) for data in files)


@lru_cache(maxsize=1)
def list_seeds() -> tuple[Seed, ...]:
    """Files of Gaussians of no pixels: one, some in one place, a few hundred of SH degree 0 and 2, and three tiers."""
    runtime, rng = ts.Runtime(threads=1), np.random.default_rng(5)
    scenes = [(1, 0, 1.0), (9, 1, 0.0), (300, 0, 1.0), (200, 2, 1.0)]
    files = [runtime.compress(make_list(n, degree, rng, size), keep_all=True) for n, degree, size in scenes]
    return tuple(Seed.of(data) for data in (*files, list_in_tiers(make_list(150, 1, rng))))


@lru_cache(maxsize=1)
def photo_file_seeds() -> tuple[Seed, ...]:
    """Files of mode photos, which the network `sweep` decodes."""
    runtime = ts.Runtime(threads=1)
    with tempfile.TemporaryDirectory() as folder:
        scene = ts.load_scene(write_scene(Path(folder) / "scene", views=2, height=16, width=16))
        files = [runtime.encode(scene, "sweep", "fast", qp, mode="photos") for qp in (0, 12)]
    return tuple(Seed.of(data) for data in files)


def _written(suffix: str, write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        write(path)
        return path.read_bytes()


@lru_cache(maxsize=8)
def gaussian_seeds(suffix: str) -> tuple[bytes, ...]:
    """Gaussian files of one suffix: per pixel with two layers, and a list."""
    noted = make_gaussians(1, 3, 4, 1, layers=2).with_notes(ts.Notes(attribution="Jörg Müller"))
    scenes = [noted, make_gaussians(2, 2, 3, 0), make_gaussians(1, 2, 2, 3)]
    files = [_written(suffix, lambda path, g=g: ts.save_gaussians(path, g)) for g in scenes]
    if suffix == ".npz":
        arrays = {n: getattr(scenes[1], n) for n in ("means", "quats", "scales", "opacities", "sh")}
        files.append(_written(suffix, lambda path: np.savez_compressed(path, **arrays)))
    if suffix == ".ply":  # normals become a filter and a property that is ignored
        files.append(files[1].replace(b" nx\n", b" filter_3D\n").replace(b" ny\n", b" t\n"))
    if suffix == ".gltf":
        files.append(files[1].replace(b"srgb_rec709_display", b"lin_rec709_display"))
    return tuple(files)


@lru_cache(maxsize=1)
def spz_seeds() -> tuple[bytes, ...]:
    """SPZ files of every version that is written."""
    scenes = [make_gaussians(1, 3, 4, 1), make_gaussians(1, 2, 2, 0)]
    return tuple(
        _written(".spz", lambda path, g=g, v=version: ts.save_gaussians(path, g, spz_version=v))
        for g in scenes
        for version in (3, 4)
    )


@lru_cache(maxsize=1)
def gltf_spz_seeds() -> tuple[bytes, ...]:
    """.glb files with SPZ inside, of 12 Gaussians and, far from the origin, of 4."""
    places = ((12, (0, 0, 0)), (4, (5e5, 4e6, 300.0)))
    return tuple(glb_of_spz(spz_seeds()[3 * i], count, place) for i, (count, place) in enumerate(places))


@lru_cache(maxsize=1)
def sog_folder_seeds() -> tuple[dict[str, bytes], ...]:
    """SOG folders by file name, of version 2 and one of 1."""
    made = []
    for scene in (make_gaussians(2, 2, 3, 0), make_gaussians(1, 2, 2, 3)):
        with tempfile.TemporaryDirectory() as folder:
            ts.save_gaussians(Path(folder) / "meta.json", scene)
            made.append({path.name: path.read_bytes() for path in Path(folder).iterdir()})
    meta = json.loads(made[1]["meta.json"])
    del meta["version"]
    limits = {"mins": [-1.0] * 4, "maxs": [1.0] * 4}
    meta["means"]["shape"] = [meta.pop("count"), 3]
    meta["scales"] = {"mins": [-3.0] * 3, "maxs": [0.0] * 3, "files": meta["scales"]["files"]}
    meta["sh0"] = {**limits, "files": meta["sh0"]["files"]}
    meta["shN"] = {"mins": -1, "maxs": 1.0, "files": meta["shN"]["files"]}
    made.append({**made[1], "meta.json": json.dumps(meta).encode()})  # version 1
    return tuple(made)


@lru_cache(maxsize=1)
def splat_seeds() -> tuple[bytes, ...]:
    """Two records of 32 bytes."""
    return (struct.pack("<6f8B", 1, 2, 3, 0.1, 0.2, 0.3, 255, 128, 0, 51, 128, 192, 128, 128) * 2,)


@lru_cache(maxsize=1)
def video_seeds() -> tuple[bytes, ...]:
    """A video of six frames of 16×16."""
    frames = [np.full((16, 16, 3), 40 * i, np.uint8) for i in range(6)]
    return (_written(".mp4", lambda path: write_video(path, frames)),)


@lru_cache(maxsize=1)
def story_seeds() -> tuple[bytes, ...]:
    """A story that plays, of views and notes, and one that nobody has told yet."""
    views = [{"title": "A", "text": "a line", "view": "0.1,0,2,34.5,-10"}, {"view": "1e3,0,-2,-180,90,3,1.5"}]
    notes = [{"at": [0.5, 0, -3], "text": "here"}]
    stories: tuple[dict[str, object], ...] = ({"seconds": 6, "views": views, "notes": notes}, {"views": []})
    return tuple(json.dumps(story).encode() for story in stories)


@lru_cache(maxsize=1)
def camera_seeds() -> tuple[bytes, ...]:
    """`cameras.json` files."""
    documents = [scene_document(make_cameras(views, 6, 8)) for views in (1, 3)]
    return tuple(
        json.dumps(document, indent=indent).encode() for document, indent in zip(documents, (None, 1), strict=True)
    )


@lru_cache(maxsize=1)
def transforms_seeds() -> tuple[bytes, ...]:
    """`transforms.json` files: intrinsics shared, per frame with a fisheye's distortion, and as angles, with points."""
    shared = transforms_document(make_cameras(2, 6, 8))
    own = {name: shared[name] for name in ("fl_x", "fl_y", "cx", "cy", "w", "h")}
    frames = [{**frame, **own, "k1": 0.01, "k2": -0.002} for frame in shared["frames"]]  # type: ignore[attr-defined]
    fisheye = {"camera_model": "OPENCV_FISHEYE", "frames": frames, "near": 1, "far": 9}
    angles = {"camera_angle_x": 0.8, "w": 8, "h": 6, "frames": shared["frames"], "ply_file_path": "points.ply"}
    return tuple(json.dumps(document).encode() for document in (shared, fisheye, angles))


@lru_cache(maxsize=1)
def colmap_seeds() -> tuple[dict[str, bytes], ...]:
    """COLMAP models by file name: text and binary, a pinhole and a camera with distortion."""
    import pycolmap

    points = np.array([[0.1, 0.05, 3.0], [-0.2, 0.1, 4.0]])
    made: list[dict[str, bytes]] = []
    for camera in (None, "OPENCV 8 6 9 9 4 3 0.01 0 0 0"):
        texts = {name: text.encode() for name, text in colmap_texts(make_cameras(2, 6, 8), points, camera).items()}
        with tempfile.TemporaryDirectory() as folder:
            for name, text in texts.items():
                (Path(folder) / name).write_bytes(text)
            pycolmap.Reconstruction(folder).write_binary(folder)
            binary = {path.name: path.read_bytes() for path in sorted(Path(folder).glob("*.bin"))}
        made += [texts, binary]
    return tuple(made)


@lru_cache(maxsize=1)
def tracker_seeds() -> tuple[tuple[str, dict[str, bytes]], ...]:
    """Names of trackers' files, and what lies in their folders: cameras with distortion, and a photo."""
    cameras, made = make_cameras(1, 6, 8), []
    lens = {"type": "radial3", "distortionParams": ["0.1", "0", "0"]}
    for write, terms in (
        (trackers.metashape, {"k1": 0.01, "p1": 0.001}),
        (trackers.realityscan, {"k1": 0.1}),
        (trackers.bundler, {"k1": 0.1, "points": [(1, 2, -3)]}),
        (trackers.meshroom, {**lens, "points": [(0, 0, 4)]}),
    ):
        with tempfile.TemporaryDirectory() as folder:
            name = write(Path(folder), cameras, **terms).name
            files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
        made.append((name, {**files, "0000.png": photo_seeds()[0]}))
    return tuple(made)


@lru_cache(maxsize=1)
def photo_seeds() -> tuple[bytes, ...]:
    """A PNG and a JPEG of 24×16."""
    pixels = make_photo(16, 24)
    return _written(".png", lambda path: write_png(path, pixels)), jpeg_bytes(pixels)


def mask_seeds() -> tuple[bytes, ...]:
    """A transparent PNG of 24×16, and a mask."""
    pixels = np.dstack([make_photo(16, 24), np.tile(np.uint8(255) * (np.arange(24) > 9).astype(np.uint8), (16, 1))])
    return png_bytes(pixels), png_bytes(pixels[..., 3])


def panorama_seeds() -> tuple[bytes, ...]:
    """Starts of a photo and of videos that say that they are 360°, old and new."""
    xmp = b'http://ns.adobe.com/xap/1.0/\0<x GPano:ProjectionType="equirectangular"/>'
    sphere = b"\0\0\0\x20sv3d\0\0\0\x18proj\0\0\0\x10equi\0\0\0\0\0\0\0\0"
    xml = b"<GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>"
    uuid = bytes.fromhex("ffcc8263f8554a938814587a02521fdd") + xml
    movies = (sphere, struct.pack(">I4s", 8 + len(uuid), b"uuid") + uuid)
    return (
        b"\xff\xd8" + struct.pack(">HH", 0xFFE1, 2 + len(xmp)) + xmp,
        *(b"\0\0\0\x0cftypisom" + struct.pack(">I4s", 8 + len(inside), b"moov") + inside for inside in movies),
    )


@lru_cache(maxsize=1)
def heic_seeds() -> tuple[bytes, ...]:
    """A HEIC photo of 24×16."""
    pixels = make_photo(16, 24)
    return (
        _written(
            ".heic", lambda path: pillow_heif.from_bytes("RGB", (24, 16), pixels.tobytes()).save(path, quality=60)
        ),
    )


def pillow_seeds() -> tuple[bytes, ...]:
    """WebP and TIFF photos of 24×16 with Exif, their lens and gravity; libtiff, which prints, reads compressed ones."""
    note = b"Apple iOS\0\0\1MM" + struct.pack(">HHHIII6i", 1, 8, 10, 3, 32, 0, 0, 1, -9, 10, -1, 10)
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x920A: 5.7, 0xA405: 26, 0xA434: "of glass", 0x927C: note})
    photo = Image.fromarray(make_photo(16, 24))
    kinds = ((".webp", {"lossless": True}), (".webp", {}), (".tif", {}))
    return tuple(_written(end, lambda path, how=how: photo.save(path, exif=exif, **how)) for end, how in kinds)


def profile_seeds() -> tuple[bytes, ...]:
    """ICC profiles of matrices, with curves of each kind."""
    numbers = [
        struct.pack(">3i", *(round(65536 * v) for v in xyz))
        for xyz in ((0.5, 0.2, 0.0), (0.3, 0.7, 0.0), (0.2, 0.1, 0.8))
    ]
    parametric = [
        b"para\0\0\0\0" + struct.pack(f">HH{count}i", kind, 0, *[60000] * count)
        for kind, count in enumerate((1, 3, 4, 5, 7))
    ]
    tables = [b"curv\0\0\0\0" + struct.pack(f">I{count}H", count, *range(count)) for count in (0, 1, 9)]
    profiles = []
    for curve in (*parametric, *tables):
        bodies = [*(b"XYZ \0\0\0\0" + xyz for xyz in numbers), curve, curve, curve]
        places = np.cumsum([132 + 12 * 6, *map(len, bodies)])
        names = (b"rXYZ", b"gXYZ", b"bXYZ", b"rTRC", b"gTRC", b"bTRC")
        tags = b"".join(
            name + struct.pack(">II", at, len(body)) for name, at, body in zip(names, places[:-1], bodies, strict=True)
        )
        header = bytes(16) + b"RGB XYZ " + bytes(12) + b"acsp" + bytes(88)
        profiles.append(header + struct.pack(">I", 6) + tags + b"".join(bodies))
    return tuple(profiles)


@lru_cache(maxsize=1)
def model_seeds() -> tuple[bytes, ...]:
    """The small graphs."""
    return tuple(
        (models_dir() / f"{name}.onnx").read_bytes() for name in ("analysis_moment", "analysis_project", "synthesis")
    )
