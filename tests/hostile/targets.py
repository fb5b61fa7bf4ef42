"""What is attacked, how, and what counts as held: every damaged input is refused with the right error or read rightly.

A target's `attack(rng)` makes one damaged input and feeds it to the product. It returns "accepted", or raises what the
product raised; anything outside `refusals` is a finding, and so is a promise of ours that does not hold.
"""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from random import Random

import numpy as np
from scenes import make_cameras

import tinysplat_runtime as ts
from tinysplat.poses.panoramas import says_panorama
from tinysplat_runtime.codec.hevc import PlaneDecoder, encode_plane
from tinysplat_runtime.codec.job import EncodeStats, Job
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, EncoderSettings, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError, ModelError, NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.artifacts import Artifact
from tinysplat_runtime.graphs.inference import GraphStore, open_graph
from tinysplat_runtime.modes.decoder import decode_file, decode_gaussians
from tinysplat_runtime.modes.recode import encode_like
from tinysplat_runtime.network.predict import predict
from tinysplat_runtime.page.story import load_story
from tinysplat_runtime.render import render
from tinysplat_runtime.scene.colours import of_icc, to_srgb
from tinysplat_runtime.scene.exif import gravity, taken_with
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.images import exif_of, is_transparent, read_image
from tinysplat_runtime.scene.intake.layouts import load_cameras, load_scene
from tinysplat_runtime.scene.masks import Mask

from . import corpus
from .containers import damage_container, damage_whole
from .damage import damage
from .documents import (
    damage_glb,
    damage_glb_spz,
    damage_json,
    damage_npz,
    damage_ply,
    damage_safetensors,
    damage_sog,
    damage_spz,
    damage_text,
)
from .graphs import damage_network, network_seeds
from .javascript import attack_javascript
from .worker import forked_usd_worker

LIMITS = Limits(max_pixels=1 << 14, max_memory_bytes=16 << 20)
"""What the attacked readers may take: small, so that a file that gets more shows in the process's memory."""


class BrokenPromiseError(AssertionError):
    """The product returned, but not what it promises."""


@dataclass(frozen=True)
class Target:
    """One entrance.

    Attributes:
        attack: makes an input and feeds it.
        refusals: errors that are the right answer.
        endings: of the Gaussian files that it makes.
    """

    name: str
    attack: Callable[[Random], None]
    refusals: tuple[type[Exception], ...]
    endings: tuple[str, ...] = ()


def _container(rng: Random) -> None:
    read_container(damage_container(rng.choice(corpus.tsplat_seeds()), rng), LIMITS)


def _info(rng: Random) -> None:
    described = inspect_bytes(damage_container(rng.choice(corpus.tsplat_seeds()), rng), LIMITS)
    json.dumps(described, allow_nan=False)


@lru_cache(maxsize=1)
def _store() -> GraphStore:
    return GraphStore(threads=1)


def _decode(rng: Random) -> None:
    data = damage_whole(rng.choice(corpus.tsplat_seeds()), rng)
    prefix = rng.randrange(len(data) + 10) if rng.random() < 0.2 else None
    is_prefix = prefix is not None
    read = read_container(data[:prefix], LIMITS, is_prefix=is_prefix, is_damaged=rng.random() < 0.2)
    gaussians = decode_file(read, _store(), threads=1)
    check_decoded(gaussians)
    if rng.random() < 0.1:
        try:
            picture = render(gaussians, gaussians.cameras[0], (8, 8), threads=1)
        except InputError:  # a camera at the end of its range, scaled beyond it
            return
        if not (np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1):
            raise BrokenPromiseError("a picture holds what is no colour")


def _list(rng: Random) -> None:
    data = damage_whole(rng.choice(corpus.list_seeds()), rng)
    prefix = rng.randrange(len(data) + 10) if rng.random() < 0.2 else None
    is_damaged = rng.random() < 0.2
    read = read_container(data[:prefix], LIMITS, is_prefix=prefix is not None, is_damaged=is_damaged)
    check_decoded(decode_file(read, _store(), threads=1))
    json.dumps(inspect_bytes(data, LIMITS, is_prefix=prefix is not None or is_damaged), allow_nan=False)


def check_decoded(gaussians: ts.Gaussians) -> None:
    """Raise unless the decoded Gaussians are what `Gaussians` promises, which the decoder does not check."""
    for n, layer in enumerate(gaussians.layers):
        lead = layer.opacities.shape
        if layer.cameras and lead != (len(layer.cameras), layer.cameras[0].height, layer.cameras[0].width):
            raise BrokenPromiseError(f"layer {n}: shape {lead}")
        for name in FIELDS:
            if not np.isfinite(getattr(layer, name)).all():
                raise BrokenPromiseError(f"layer {n}: {name} is not finite")
        if layer.opacities.min() < 0 or layer.opacities.max() > 1 or layer.scales.min() < 0:
            raise BrokenPromiseError(f"layer {n}: opacities or scales out of range")
        if np.abs(np.linalg.norm(layer.quats, axis=-1) - 1).max() > 1e-3:
            raise BrokenPromiseError(f"layer {n}: a quaternion is not of length 1")


@lru_cache(maxsize=1)
def _planes() -> tuple[tuple[bytes, bytes, np.ndarray], ...]:
    """(parameter sets, slice, decoded picture) of 16×16 planes at several QPs and settings."""
    codes = np.random.default_rng(0).integers(0, 4096, (16, 16)).astype(np.uint16)
    smooth = (np.add.outer(np.arange(16), 3 * np.arange(16)) * 40).astype(np.uint16)
    settings = EncoderSettings("medium"), EncoderSettings("ultrafast", ("min-cu-size=8",))
    made = []
    for plane in (codes, smooth):
        for qp in (0, 12, 30, 51):
            for one in settings:
                coded = encode_plane(plane, qp, one)
                out = np.empty((16, 16), np.uint16)
                PlaneDecoder(coded.parameter_sets, 16, 16).decode_into(coded.payload, out)
                made.append((coded.parameter_sets, coded.payload, out))
    return tuple(made)


def _picture(rng: Random) -> None:
    """A damaged slice through libavcodec; whatever it did, the next good slice must come out right."""
    sets, payload, wanted = rng.choice(_planes())
    decoder, out = PlaneDecoder(sets, 16, 16), np.empty((16, 16), np.uint16)
    try:
        decoder.decode_into(damage(payload, rng), out)
    finally:
        decoder.decode_into(payload, out)
        if (out != wanted).any():
            raise BrokenPromiseError("a good picture behind a damaged one came out wrong")


def _parameter_sets(rng: Random) -> None:
    """Damaged parameter sets: other sizes, depths and chroma than the file's header says."""
    sets, payload, _ = rng.choice(_planes())
    decoder = PlaneDecoder(damage(sets, rng), 16, 16)
    decoder.decode_into(damage(payload, rng) if rng.random() < 0.3 else payload, np.empty((16, 16), np.uint16))


def _from_file(
    suffix: str,
    seeds: Callable[[], tuple[bytes, ...]],
    read: Callable[[Path], object],
    spoil: Callable[[bytes, Random], bytes] = damage,
) -> Callable[[Random], None]:
    def attack(rng: Random) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"f{suffix}"
            path.write_bytes(spoil(rng.choice(seeds()), rng))
            read(path)

    return attack


def _gaussian_file(
    suffix: str,
    spoil: Callable[[bytes, Random], bytes],
    seeds: Callable[[], tuple[bytes, ...]] | None = None,
    name: str | None = None,
) -> Target:
    def load(path: Path) -> None:
        ts.load_gaussians(path, max_bytes=LIMITS.max_memory_bytes)

    attack = _from_file(suffix, seeds or (lambda: corpus.gaussian_seeds(suffix)), load, spoil)
    return Target(name or suffix.removeprefix("."), attack, (InputError,), (suffix,))


def _video(path: Path) -> None:
    video = open_video(path)
    for index in {0, len(video.stamps) - 1}:
        if video.frame(index).shape != (video.height, video.width, 3):
            raise BrokenPromiseError("a frame of another size than the video's")


def _mask(path: Path) -> None:
    for is_opacity in (False, True):
        if set(np.unique(Mask(path, is_background=False, is_opacity=is_opacity).kept(16, 24))) - {0, 255}:
            raise BrokenPromiseError("a mask neither keeps nor leaves out")
    is_transparent(path)


def _exif(path: Path) -> None:
    said = exif_of(path)
    taken_with(said)
    if not np.isfinite(gravity(said) or 0).all():
        raise BrokenPromiseError("gravity that is no number")


def _panorama(path: Path) -> None:
    if not says_panorama(path):
        raise InputError("not said to be 360°")


def _profile(path: Path) -> None:
    colours = of_icc(path.read_bytes())
    if colours is None:
        raise InputError("nothing that changes colours")
    to_srgb(np.arange(48, dtype=np.uint8).reshape(4, 4, 3), colours)


def _cameras(path: Path) -> None:
    load_cameras(path)
    load_scene(path)


def _story(path: Path) -> None:
    story = load_story(path)
    json.dumps(story.document, allow_nan=False)
    story.cameras(make_cameras(2, 8, 8))


def _transforms(rng: Random) -> None:
    """A damaged `transforms.json`, sometimes beside a damaged point cloud."""
    with tempfile.TemporaryDirectory() as folder:
        points = rng.choice(corpus.gaussian_seeds(".ply"))
        (Path(folder) / "points.ply").write_bytes(damage_ply(points, rng) if rng.random() < 0.3 else points)
        (Path(folder) / "transforms.json").write_bytes(damage_json(rng.choice(corpus.transforms_seeds()), rng))
        load_scene(folder)


def _colmap(rng: Random) -> None:
    """A model with one or two damaged files."""
    seed = dict(rng.choice(corpus.colmap_seeds()))
    for name in rng.sample(sorted(seed), rng.choice((1, 1, 2))):
        seed[name] = (damage_text if name.endswith(".txt") else damage)(seed[name], rng)
    with tempfile.TemporaryDirectory() as folder:
        for name, data in seed.items():
            (Path(folder) / name).write_bytes(data)
        load_scene(folder)


def _tracker(rng: Random) -> None:
    """A damaged file of another tracker, sometimes with a damaged list of names, beside its photos."""
    name, files = rng.choice(corpus.tracker_seeds())
    with tempfile.TemporaryDirectory() as folder:
        for other, data in files.items():
            if other == name or (other.endswith(".txt") and rng.random() < 0.3):
                data = (damage_json if other.endswith(".sfm") else damage_text)(data, rng)
            (Path(folder) / other).write_bytes(data)
        load_scene(Path(folder) / name)


def _sog_folder(rng: Random) -> None:
    """A folder with a damaged `meta.json`, or pictures damaged, swapped or left out."""
    files = dict(rng.choice(corpus.sog_folder_seeds()))
    if rng.random() < 0.6:
        files["meta.json"] = damage_json(files["meta.json"], rng)
    name = rng.choice(sorted(files.keys() - {"meta.json"}))
    match rng.randrange(4):
        case 0:
            files[name] = damage(files[name], rng)
        case 1:
            files[name] = files[rng.choice(sorted(files))]
        case 2:
            del files[name]
        case _:
            pass
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            (Path(folder) / name).write_bytes(data)
        ts.load_gaussians(Path(folder) / "meta.json", max_bytes=LIMITS.max_memory_bytes)


USD = ((".usda", damage_text), (".usda", damage_text), (".usdc", damage), (".usdz", damage))


def _usd(rng: Random) -> None:
    """Damaged text, or damaged binary, in a process of its own and within bounds."""
    suffix, spoil = rng.choice(USD)
    with tempfile.TemporaryDirectory() as folder, forked_usd_worker():
        path = Path(folder) / f"f{suffix}"
        path.write_bytes(spoil(rng.choice(corpus.gaussian_seeds(suffix)), rng))
        ts.load_gaussians(path, max_bytes=LIMITS.max_memory_bytes)


def _photo_file(rng: Random) -> None:
    data = damage_container(rng.choice(corpus.photo_file_seeds()), rng)
    if rng.random() < 0.5:
        data = damage_whole(rng.choice(corpus.photo_file_seeds()), rng)
    json.dumps(inspect_bytes(data, LIMITS), allow_nan=False)
    check_decoded(decode_gaussians(data, _store(), threads=1, limits=LIMITS))


def _like(rng: Random) -> None:
    """A damaged file as the model of another scene's coding."""
    seed = rng.choice(corpus.tsplat_seeds()[:3])
    data = damage_whole(seed, rng)
    scene = decode_gaussians(seed.data, _store(), threads=1)
    if rng.random() < 0.5:
        scene.opacities[:, ::2] = 0.5
    job = Job(scene, find_profile(DEFAULT_PROFILE), 0.0, _store(), 1, EncodeStats())
    coded = encode_like(job, data, LIMITS)
    check_decoded(decode_gaussians(coded, _store(), threads=1))


def _network(path: Path) -> None:
    graph = open_graph(Artifact("f", path), "network", threads=1)
    cameras = make_cameras(2, 8, 8)
    gaussians = predict(np.full((2, 8, 8, 3), 0.5, np.float32), cameras, 1.0, 9.0, graph)
    for layer in gaussians.layers:  # of any length: quaternions are normalised where they are used
        lengths = np.linalg.norm(layer.quats.astype(np.float64), axis=-1, keepdims=True)
        np.divide(layer.quats, lengths, out=layer.quats, where=lengths > 0, casting="same_kind")
    check_decoded(gaussians)


def _model(path: Path) -> None:
    graph = open_graph(Artifact("f", path), "analysis_moment", threads=1)
    graph.run({"sh": np.ones((1, 2, 2, 4, 3), np.float32)})


TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        Target("container", _container, (FormatError,)),
        Target("info", _info, (FormatError,)),
        Target("decode", _decode, (FormatError,)),
        Target("javascript", lambda rng: attack_javascript(rng, LIMITS), (FormatError,)),
        Target("list", _list, (FormatError,)),
        Target("picture", _picture, (FormatError,)),
        Target("parameter_sets", _parameter_sets, (FormatError,)),
        _gaussian_file(".npz", damage_npz),
        _gaussian_file(".safetensors", damage_safetensors),
        _gaussian_file(".ply", damage_ply),
        _gaussian_file(".spz", damage_spz, corpus.spz_seeds),
        _gaussian_file(".compressed.ply", damage_ply),
        _gaussian_file(".glb", damage_glb),
        _gaussian_file(".gltf", damage_json),
        _gaussian_file(".glb", damage_glb_spz, corpus.gltf_spz_seeds, "glb_spz"),
        _gaussian_file(".sog", damage_sog),
        Target("sog_folder", _sog_folder, (InputError,), ("meta.json",)),
        _gaussian_file(".splat", damage, corpus.splat_seeds),
        Target("usd", _usd, (InputError,), (".usd", *(suffix for suffix, _ in USD))),  # .usd is text or binary
        Target("transforms", _transforms, (InputError,)),
        Target("colmap", _colmap, (InputError,)),
        Target("trackers", _tracker, (InputError,)),
        Target("photos", _photo_file, (FormatError, ModelError, InputError, NumericError)),
        Target("like", _like, (FormatError, InputError, NumericError)),
        Target("network", _from_file(".onnx", network_seeds, _network, damage_network), (ModelError, NumericError)),
        Target("cameras", _from_file(".json", corpus.camera_seeds, _cameras, damage_json), (InputError,)),
        Target("story", _from_file(".json", corpus.story_seeds, _story, damage_json), (InputError,)),
        Target("png", _from_file(".png", lambda: corpus.photo_seeds()[:1], read_image), (InputError,)),
        Target("jpeg", _from_file(".jpg", lambda: corpus.photo_seeds()[1:], read_image), (InputError,)),
        Target("mask", _from_file(".png", corpus.mask_seeds, _mask), (InputError,)),
        Target("panorama", _from_file(".mp4", corpus.panorama_seeds, _panorama), (InputError,)),
        Target("heic", _from_file(".heic", corpus.heic_seeds, read_image), (InputError,)),
        Target("webp and tiff", _from_file(".webp", corpus.pillow_seeds, read_image), (InputError,)),
        Target("lens", _from_file(".webp", corpus.pillow_seeds, _exif), (InputError,)),
        Target("profile", _from_file(".icc", corpus.profile_seeds, _profile), (InputError,)),
        Target("video", _from_file(".mp4", corpus.video_seeds, _video), (InputError,)),
        Target("onnx", _from_file(".onnx", corpus.model_seeds, _model), (ModelError,)),
    )
}


@dataclass(frozen=True)
class Outcome:
    """What became of one attack: "accepted", "refused", or "finding" with what happened."""

    kind: str
    message: str = ""


def attack(target: Target, case: int) -> Outcome:
    """Run attack number `case`; the same number is the same input."""
    try:
        target.attack(Random(f"{target.name} {case}"))
    except target.refusals as error:
        text = str(error)
        fine = "\n" not in text and len(text) < 600
        return Outcome("refused", text) if fine else Outcome("finding", f"message of {len(text)} characters")
    except Exception as error:
        return Outcome("finding", f"{type(error).__name__}: {error}")
    return Outcome("accepted")


def prepare(target: Target) -> None:
    """Do what the first attack would do once: make seeds, import libraries, open graphs."""
    for case in range(-3, 0):
        attack(target, case)
