"""What a file carries: Gaussians, the photos that a network turns into them, or photos and what the network lacks.

    gaussians   planes of the network's output; any receiver decodes it. The default.
    photos      the photos and the network's hash: a tenth of the size, for receivers that have the network.
    hybrid      photos, and planes with the difference between what the network makes of the decoded photos and what it
                made of the originals.
    auto        photos where every installation has the network, it is quick, and the file comes out smaller; else
                gaussians. Hybrid files are for who asks for them: they are never the smallest.

docs/MODES.md has figures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..container.extras import CodedPhotos, network_section, photo_sections
from ..container.reader import read_container
from ..container.records import NetworkRef
from ..container.writer import write_container
from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..graphs.artifacts import load_manifest
from ..graphs.inference import GraphStore
from ..graphs.predict import predict
from ..scene.scenes import Scene
from .encoder import EncodeStats, PhotoMode, SceneEncoder, check_qp
from .photos import decode_photos, encode_photos
from .profiles import Profile
from .residual import hybrid_settings

MODES = ("gaussians", "photos", "hybrid", "auto")

AUTO_SECONDS = 2.0
"""`auto` takes photos only if the network runs within this time here: what decoding would take on a like machine."""


@dataclass(frozen=True)
class PhotoScene:
    """Photos as the network was given them, and which network it was.

    Attributes:
        images: (V, H, W, 3) float32 RGB in [0, 1].
        gaussians: what the network made of them; their cameras are the photos'.
        network: the network's name and hash, and its depth range.
        model: the network as the user named it.
    """

    images: NDArray
    gaussians: Gaussians
    network: NetworkRef
    model: str


def photo_scene(scene: Scene, gaussians: Gaussians, model: str, store: GraphStore) -> PhotoScene:
    """The photos behind `gaussians`, which the network `model` made of `scene`."""
    near, far = scene.depth_range()
    return PhotoScene(scene.images(), gaussians, NetworkRef(*store.network_ref(model), near, far), model)


def compress_photos(scene: PhotoScene, profile: Profile, qp: float, *, threads: int, stats: EncodeStats) -> bytes:
    """A file of mode `photos`; InputError for a Q_g beyond ±60."""
    photos = _coded(scene, profile, qp, threads, stats)
    cameras = scene.gaussians.cameras
    with stats.watch.stage("write"):
        notes = scene.gaussians.notes
        return write_container([], cameras, np.zeros(3), profile.name, qp, _sections(scene, photos), notes=notes)


def compress_hybrid(
    scene: PhotoScene, profile: Profile, qp: float, store: GraphStore, *, threads: int, stats: EncodeStats
) -> bytes:
    """A file of mode `hybrid`.

    Raises:
        InputError: profile `paper`, or a Q_g beyond ±60.
        NumericError: Gaussians at or behind their own camera.
    """
    hybrid_settings(profile)
    photos = _coded(scene, profile, qp, threads, stats)
    sections = _sections(scene, photos)
    # The photos are read back from a file, so that the encoder sees exactly what the decoder will.
    container = read_container(write_container([], scene.gaussians.cameras, np.zeros(3), "", qp, sections))
    assert container.photos is not None
    images = decode_photos(container.photos, photos.parameter_sets, threads)
    network = scene.network
    with stats.watch.stage("network"):
        graph = store.network_by_hash(network.name, network.sha256, scene.model)
        prediction = predict(images, container.cameras, network.near, network.far, graph)
    mode = PhotoMode(prediction, sections)
    encoder = SceneEncoder(scene.gaussians, profile, store, threads=threads, stats=stats, photo_mode=mode)
    return encoder.code(encoder.plan(qp), qp)


def choose(planes: bytes, photos: bytes, network: NetworkRef, network_seconds: float) -> tuple[str, str]:
    """What `auto` takes, `gaussians` or `photos`, and why."""
    ships = any(a.role == "network" and a.sha256 == network.sha256 for a in load_manifest().values())
    sizes = f"{len(photos)} bytes of photos, {len(planes)} of Gaussians"
    if not ships:
        return "gaussians", f"receivers may lack network '{network.name}' ({sizes})"
    if network_seconds > AUTO_SECONDS:
        return "gaussians", f"the network takes {network_seconds:.1f} s, over {AUTO_SECONDS:g} ({sizes})"
    if len(photos) >= len(planes):
        return "gaussians", f"the smaller file ({sizes})"
    return "photos", f"{sizes}; every installation has '{network.name}', which took {network_seconds:.1f} s here"


def check_options(mode: str, *, has_target: bool) -> None:
    """InputError for a mode that there is not, or one that a target contradicts."""
    if mode not in MODES:
        raise InputError(f"'{mode}', accepted are {', '.join(MODES)}", where="mode")
    if has_target and mode != "gaussians":
        raise InputError(f"'{mode}' with a target, lossless or like, which only gaussians can be given", where="mode")


def _coded(scene: PhotoScene, profile: Profile, qp: float, threads: int, stats: EncodeStats) -> CodedPhotos:
    check_qp(qp)
    with stats.watch.stage("x265"):
        return encode_photos(scene.images, qp, profile.encoder, threads)


def _sections(scene: PhotoScene, photos: CodedPhotos) -> tuple[tuple[bytes, int, bytes], ...]:
    return network_section(scene.network), *photo_sections(photos)
