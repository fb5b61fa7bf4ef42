"""Rewrite the conformance corpus: small files, what they test, and what decoding them gives.

    PYTHONPATH=tests python -m conformance.make

A reviewed decision, as golden files are: a case that is there keeps its meaning.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zlib import crc32

import numpy as np
from scenes import free_in_tiers, make_free_gaussians, make_skewed_cameras, make_smooth_gaussians, write_scene
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.photos import GROUPS, PHOTOS, group_sections
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.scene.neighbours import Group

from .parts import in_parts
from .reference import arrays_of, decode

CASES = Path(__file__).parent / "cases"

TOLERANCE = {"means": 1e-6, "quats": 1e-6, "scales": 1e-5, "opacities": 1e-6, "sh": 2e-6}
"""Of an array's largest value: what float32 may add to it."""


@dataclass(frozen=True)
class Case:
    """A file.

    Attributes:
        name: its folder's.
        tests: in a line, for people.
        data: the file.
        options: how it is to be decoded: `maxBytes`, `recover`, `views`.
        needs: what else a decoder needs: `network`, `views` (format 1.5).
        refused: whether it must be.
        like: the file in one piece and the views of it that decoding gives, where it does not tell by itself.
        scale: what differences of SH coefficients are a share of, where decoded ones cancel.
    """

    name: str
    tests: str
    data: bytes
    options: dict[str, Any] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    refused: bool = False
    like: tuple[bytes, list[int]] | None = None
    scale: float | None = None


def compress(gaussians: ts.Gaussians, profile: str = "balanced", qp: float = 0, **options: Any) -> bytes:
    """A file's bytes."""
    return ts.Runtime(threads=1).compress(gaussians, profile, qp, **options)


def lossless(gaussians: ts.Gaussians) -> bytes:
    """A file's bytes, of mode lossless."""
    return ts.Runtime(threads=1).compress(gaussians, lossless=True)


def changed(data: bytes, kind: bytes, change: Callable[[bytearray], None], index: int = 0) -> bytes:
    """The file with one section's bytes changed, checksums right."""
    sections = sections_of(data)
    for section in sections:
        if (section[0], section[2]) == (kind, index):
            text = bytearray(section[3])
            change(text)
            section[3] = bytes(text)
    return file_of(sections)


def with_minor(data: bytes, minor: int) -> bytes:
    """The file as one of that minor version."""
    end = L.HEADER.size + len(sections_of(data)) * L.TABLE_ROW.size
    head = data[:10] + struct.pack("<HHH", minor, len(sections_of(data)), 7)
    return head + struct.pack("<I", crc32(head + data[L.HEADER.size : end])) + data[L.HEADER.size :]


def replaced(sections: list[list], kind: bytes, data: bytes) -> list[list]:
    """Sections, of which those of a type have other bytes."""
    return [[k, f, i, data if k == kind else d] for k, f, i, d in sections]


def poked(at: int, value: bytes) -> Callable[[bytearray], None]:
    """What writes bytes at a place."""

    def change(text: bytearray) -> None:
        text[at : at + len(value)] = value

    return change


def planes() -> Iterator[Case]:
    """Mode gaussians: profiles, SH degrees, layers, sizes."""
    yield Case("paper_degree0", "profile paper, 5x7, one view", compress(make_smooth_gaussians(1, 5, 7, 0), "paper"))
    yield Case(
        "paper_degree2", "VABR, SAO, three views", compress(make_smooth_gaussians(3, 9, 12, 2, seed=1), "paper", 3)
    )
    yield Case("paper_degree4", "all 75 coefficients", compress(make_smooth_gaussians(1, 8, 8, 4, seed=2), "paper", -6))
    yield Case("fast_degree1", "profile fast, QPs by blocks", compress(make_smooth_gaussians(2, 12, 20, 1), "fast"))
    yield Case("fast_fine", "depth in two pictures", compress(make_smooth_gaussians(1, 16, 16, 1), "fast", -18))
    yield Case("balanced_degree0", "PCA of RGB, relative rotations", compress(make_smooth_gaussians(2, 16, 16, 0)))
    data = compress(make_smooth_gaussians(2, 20, 24, 3, seed=3, layers=2))
    yield Case("balanced_layers", "two layers with their own k and intrinsics, SH degree 3 and 0", data)
    yield Case("three_layers", "three layers", compress(make_smooth_gaussians(2, 16, 20, 1, layers=3), "fast"))
    yield Case("max_odd", "profile max, 13x21: padding", compress(make_smooth_gaussians(1, 13, 21, 1), "max"))
    yield Case("max_coarse", "Q_g 24", compress(make_smooth_gaussians(1, 17, 18, 1), "max", 24), scale=4.0)
    yield Case("row", "1x33", compress(make_smooth_gaussians(1, 1, 33, 0, seed=4)))
    origin = np.array([4.5e6, -3.2e5, 5.1e6])
    yield Case("far_origin", "cameras 7,000 km away", compress(make_smooth_gaussians(2, 9, 9, 0, origin=origin)))
    scene = make_smooth_gaussians(1, 10, 10, 0)
    flat = replace(
        scene,
        quats=np.broadcast_to(np.float32([1, 0, 0, 0]), scene.quats.shape),
        opacities=np.full_like(scene.opacities, 0.7),
        sh=np.broadcast_to(np.float32([0.1, 0.2, 0.3]), scene.sh.shape),
    )
    yield Case("constants", "channels that are numbers", compress(flat, "paper"))
    data = compress(replace(flat, cameras=make_skewed_cameras(1, 10, 10, turn=0.0)), "paper")
    yield Case("no_rotation", "quaternions whose components are all 0: the identity", zero_rotation(data))
    text = compress(make_smooth_gaussians(1, 8, 8, 0))
    yield Case("rough_pose", "c2w 5e-4 off a rotation: the nearest one", changed(text, b"CAMS", roughen))


def zero_rotation(data: bytes) -> bytes:
    """The file with every constant of its rotations at 0."""

    def change(text: bytearray) -> None:
        for at in range(len(text) - 12):
            if text[at] == 4 and text[at + 1] < 4 and text[at + 2] == 0 and text[at + 4 : at + 8] == bytes(4):
                text[at + 8 : at + 12] = bytes(4)

    return changed(data, b"LAYR", change)


def roughen(text: bytearray) -> None:
    """Move an entry of the first rotation."""
    (entry,) = struct.unpack("<d", text[40:48])
    text[40:48] = struct.pack("<d", entry + 2e-4)


def structure() -> Iterator[Case]:
    """Versions, sections, prefixes."""
    scene = make_smooth_gaussians(2, 16, 16, 1, seed=5, layers=2)
    scene = replace(scene, sh=scene.sh * np.array([1, 8, 8, 8], np.float32)[:, None])
    data = compress(scene)
    yield Case("parts", "a class in two parts, two passes", data)
    ends = [entry["bytes"] for entry in ts.inspect(data)["prefixes"]]
    for number, end in enumerate(ends[:-1:2]):
        yield Case(f"prefix{number}", "a prefix that ends with a pass", data, {"maxBytes": end}, scale=1.0)
    first = len(data) - sum(len(d) for k, _, _, d in sections_of(data) if k in L.PLANES.values())
    yield Case("prefix_hidden", "a view without depth", data, {"maxBytes": first + 250}, scale=1.0)
    spoilt = bytearray(data)
    spoilt[ends[-1] - 5] ^= 16
    yield Case("recover", "a picture whose CRC differs, left out", bytes(spoilt), {"recover": True}, scale=1.0)
    small = make_smooth_gaussians(1, 6, 6, 0)
    noted = small.with_notes(ts.Notes("metre", "Jörg Müller, Ελένη", "CC-BY-4.0"))
    yield Case("minor1_note", "format 1.1: NOTE", compress(noted))
    yield Case("minor2_refined", "format 1.2: REFI", compress(small.with_notes(ts.Notes(refined="20 steps"))))
    yield Case("minor3_antialiased", "format 1.3: ANTI", compress(small.with_notes(ts.Notes(antialiased="yes"))))
    sections = sections_of(compress(small))
    sections.insert(2, [b"XTRA", 0, 3, b"of a later version"])
    yield Case("unknown_section", "format 1.77: an optional section to skip", with_minor(file_of(sections), 77))
    metadata = [s for s in sections if s[0] not in L.PLANES.values()]
    pictures = [s for s in sections if s[0] in L.PLANES.values()]
    yield Case("any_order", "plane sections the other way round", file_of([*metadata[::-1], *pictures[::-1]]))
    whole = compress(make_smooth_gaussians(4, 8, 12, 1, seed=6, layers=2))
    units, needs = in_parts(whole), ("views",)
    yield Case("minor5_units", "format 1.5: views as units", units, {}, needs, like=(whole, [0, 1, 2, 3]))
    yield Case("units_chosen", "views 2 and 0 of them", units, {"views": [2, 0]}, needs, like=(whole, [2, 0]))
    end = len(units) - len(sections_of(units)[-1][3]) + 20
    yield Case("units_prefix", "the views before its end", units, {"maxBytes": end}, needs, like=(whole, [0, 1, 2]))


def other_modes() -> Iterator[Case]:
    """Modes free, lossless and photos."""
    rng = np.random.default_rng(7)
    data = compress(make_free_gaussians(300, 1, rng), keep_all=True)
    yield Case("minor4_free", "format 1.4: mode free, SH degree 1", data)
    yield Case(
        "free_degree3",
        "SH degree 3, radii far apart",
        compress(make_free_gaussians(90, 3, rng, 40.0), qp=-6, keep_all=True),
    )
    yield Case("free_one", "one Gaussian", compress(make_free_gaussians(1, 0, rng), keep_all=True))
    crowd = make_free_gaussians(600, 0, rng, 0.0)
    yield Case("free_crowd", "600 in one place: numbers beyond a byte", compress(crowd, keep_all=True))
    end = ts.inspect(data)["prefixes"][0]["bytes"]
    yield Case("free_prefix", "a prefix that holds what sorts", data, {"maxBytes": end}, scale=1.0)
    tiers = free_in_tiers(make_free_gaussians(400, 1, rng))
    yield Case("minor6_tiers", "format 1.6: mode free in three tiers", tiers)
    ends = [entry["bytes"] for entry in ts.inspect(tiers)["prefixes"]]
    yield Case("tiers_one", "the first tier, larger as others are absent", tiers, {"maxBytes": ends[3] - 1}, scale=1.0)
    yield Case("tiers_spheres", "a second tier without rotations", tiers, {"maxBytes": ends[3]}, scale=1.0)
    few = replace(
        make_free_gaussians(60, 0, np.random.default_rng(17)), viewpoints=tuple(make_skewed_cameras(3, 12, 16))
    )
    yield Case(
        "minor7_viewpoints",
        "format 1.7: cameras of the photos that Gaussians were made from",
        compress(few, keep_all=True),
    )
    exact = lossless(make_smooth_gaussians(2, 6, 9, 1, layers=2))
    yield Case("lossless", "exact planes, two layers", exact)
    with TemporaryDirectory() as folder:
        photos = ts.load_scene(write_scene(Path(folder) / "scene", views=2, height=16, width=16))
        made = ts.Runtime(threads=1).encode(photos, "sweep", "fast", mode="photos")
        yield Case("photos", "mode photos, network sweep", made, needs=("network",))
        yield Case("groups", "photos that the network is given in two groups", in_groups(folder), needs=("network",))


def in_groups(folder: str) -> bytes:
    """A file of three photos, of which the network is given two at a time."""
    photos = ts.load_scene(write_scene(Path(folder) / "three", views=3, height=16, width=16))
    (section,) = group_sections([Group((0, 1), (0, 1)), Group((1, 2), (2,))])
    made = sections_of(ts.Runtime(threads=1).encode(photos, "sweep", "fast", mode="photos"))
    at = next(i for i, (kind, *_) in enumerate(made) if kind == PHOTOS)
    return with_minor(file_of([*made[:at], [GROUPS, 1, 0, section.data], *made[at:]]), 5)


def refused() -> Iterator[Case]:
    """Files that a reader must not accept."""
    data = compress(make_smooth_gaussians(2, 8, 8, 1, seed=8), "fast")
    sections = sections_of(data)
    free = compress(make_free_gaussians(40, 0, np.random.default_rng(9)), keep_all=True)
    exact = lossless(make_smooth_gaussians(1, 4, 4, 0))

    def made(name: str, tests: str, file: bytes, **options: Any) -> Case:
        return Case(f"refused_{name}", tests, file, refused=True, **options)

    yield made("magic", "another magic", b"\x89TSPLOT\n" + data[8:])
    yield made("major", "major version 2", file_of(sections, 2))
    yield made("table_crc", "the table altered", data[:30] + bytes([data[30] ^ 1]) + data[31:])
    yield made("section_crc", "LAYR altered", data.replace(b"fast", b"fasd", 1))
    yield made("cut", "cut short", data[:-1])
    yield made("behind", "a byte behind the last section", data + b"\0")
    yield made("required", "an unknown section that is required", file_of([*sections, [b"XTRA", 1, 0, b""]]))
    yield made("twice", "two sections SCEN", file_of([sections[0], *sections]))
    yield made("other_mode", "FREP in a file of mode gaussians", file_of([*sections, [b"FREP", 1, 0, b""]]))
    yield made("pose", "a camera whose c2w is no rotation", changed(data, b"CAMS", poked(40, struct.pack("<d", 0.2))))
    yield made("origin", "an origin that is not finite", changed(data, b"SCEN", poked(8, struct.pack("<d", np.nan))))
    yield made("size", "a grid of 65536x65536", changed(data, b"LAYR", poked(0, struct.pack("<II", 65536, 65536))))
    yield made("degree", "SH degree 5", changed(data, b"LAYR", poked(8, b"\5\5")))
    yield made("flags", "an unknown flag of a layer", changed(data, b"LAYR", poked(10, b"\x80")))
    yield made("range", "a depth beyond float32", changed(data, b"LAYR", poked(20, struct.pack("<f", 3e38))))
    yield made("picture_crc", "a picture altered", data[:-3] + bytes([data[-3] ^ 1]) + data[-2:])
    metadata = len(data) - sum(len(d) for k, _, _, d in sections if k in L.PLANES.values())
    yield made("no_depth", "a prefix without any picture", data, options={"maxBytes": metadata + 9})
    larger = next(d for k, _, _, d in sections_of(compress(make_smooth_gaussians(1, 32, 8, 0), "fast")) if k == b"HEVC")
    yield made("size_of_pictures", "pictures of another size", file_of(replaced(sections, b"HEVC", larger)))
    yield made("note", "a note that turns text round", file_of([*sections, [b"REFI", 0, 0, b"\xe2\x80\xae"]]))
    hidden = "\U00013439".encode()  # which Unicode 14 does not know
    yield made(
        "character", "a note with a character that does not print", file_of([*sections, [b"REFI", 0, 0, hidden]])
    )
    sets = next(d for k, _, _, d in sections if k == b"HEVC")
    yield made("sets", "1025 bytes of parameter sets", file_of(replaced(sections, b"HEVC", sets.ljust(1025, b"\0"))))
    with TemporaryDirectory() as folder:
        keeps_none = changed(in_groups(folder), GROUPS, poked(3, struct.pack("<HH", 0, 1)))
    yield made("groups", "a group that keeps no photo", keeps_none)
    yield made("free_levels", "an octree with two roots", changed(free, b"FREE", poked(92, struct.pack("<I", 2))))
    yield made("free_count", "more Gaussians than bytes pay for", changed(free, b"FREE", poked(0, b"\0\0\1\0")))
    yield made("free_points", "positions that are no LZMA2", changed(free, b"FREP", poked(0, b"\x7f")))
    tiers = free_in_tiers(make_free_gaussians(60, 0, np.random.default_rng(9)))
    yield made("tier_growth", "scales that grow by e^3", changed(tiers, b"TIER", poked(24, b"\0\0\x40\x40"), 1))
    sections = sections_of(tiers)
    renamed = [[k, f, 3 if (k, index) == (b"TIER", 2) else index, d] for k, f, index, d in sections]
    yield made("tier_gap", "a tier 1 and a tier 3", file_of(renamed))
    yield made("exact_hash", "exact planes of another SHA-256", changed(exact, b"EXAC", poked(20, b"\0\0\0")))
    units = sections_of(in_parts(data))
    yield made("unit_order", "views as units, out of order", file_of([*units[:-2], units[-1], units[-2]]))


def chosen(data: bytes, views: list[int]) -> ts.Gaussians:
    """These views of a file."""
    layers = [
        replace(
            layer,
            extra_layers=(),
            cameras=[layer.cameras[view] for view in views],
            **{name: getattr(layer, name)[views] for name in FIELDS},
        )
        for layer in decode(data).layers
    ]
    return replace(layers[0], extra_layers=tuple(layers[1:]))


def write(case: Case) -> int:
    """Write a case's folder; returns its bytes."""
    folder = CASES / case.name
    folder.mkdir(parents=True)
    path = folder / f"{case.name}.tsplat"
    path.write_bytes(case.data)
    described: dict[str, Any] = {"tests": case.tests, "sha256": sha256(case.data).hexdigest()}
    described |= {key: value for key, value in (("options", case.options), ("needs", list(case.needs))) if value}
    if case.refused:
        described["refused"] = True
    else:
        arrays = arrays_of(chosen(*case.like) if case.like else decode(case.data, **case.options))
        np.savez_compressed(folder / "expected.npz", **arrays)
        described["tolerance"] = TOLERANCE
        if case.scale:
            described["scales"] = {"sh": case.scale}
    (folder / "case.json").write_text(json.dumps(described, indent=1, ensure_ascii=False) + "\n")
    return sum(file.stat().st_size for file in folder.iterdir())


def main() -> None:
    """Write all cases."""
    shutil.rmtree(CASES, ignore_errors=True)
    total = 0
    for case in (*planes(), *structure(), *other_modes(), *refused()):
        size = write(case)
        total += size
        print(f"{size:8} {case.name}: {case.tests}")
    print(f"{total:8} bytes in {len(list(CASES.iterdir()))} cases")


if __name__ == "__main__":
    main()
