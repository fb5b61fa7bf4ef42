"""Rewrite the conformance corpus: small files, what they test, and what decoding them gives.

    PYTHONPATH=tests python -m conformance.make

A reviewed decision, as golden files are: a case that is there keeps its meaning.
"""

import json
import shutil
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scenes import list_in_tiers, make_list, make_skewed_cameras, make_smooth_gaussians, write_scene
from sections import Pict, beside, changed_section, file_of, repacked, sections_of, with_picture

import tinysplat_runtime as ts

from .reference import arrays_of, decode

CASES = Path(__file__).parent / "cases"

TOLERANCE = {"means": 1e-6, "quats": 1e-6, "scales": 1e-5, "opacities": 1e-6, "sh": 2e-6}
"""Of an array's largest value: what float32 may add to it."""


@dataclass(frozen=True)
class Case:
    """A file.

    Attributes:
        name: its folder's.
        tests: in a line, for people: what a decoder could get wrong that no other case would show.
        data: the file.
        options: how it is to be decoded: `maxBytes`, `recover`.
        needs: what else a decoder needs: `network`.
        refused: whether it must be.
        scale: what differences of SH coefficients are a share of, where decoded ones cancel.
    """

    name: str
    tests: str
    data: bytes
    options: dict[str, Any] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    refused: bool = False
    scale: float | None = None


def compress(gaussians: ts.Gaussians, profile: str = "balanced", qp: float = 0, **options: Any) -> bytes:
    """A file's bytes."""
    return ts.Runtime(threads=1).compress(gaussians, profile, qp, **options)


def lossless(gaussians: ts.Gaussians) -> bytes:
    """A file's bytes, of mode lossless."""
    return ts.Runtime(threads=1).compress(gaussians, lossless=True)


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
    yield Case("fast_degree1", "QPs by blocks", compress(make_smooth_gaussians(2, 12, 20, 1), "fast"))
    yield Case("fast_fine", "depth in two pictures", compress(make_smooth_gaussians(1, 16, 16, 1), "fast", -18))
    data = compress(make_smooth_gaussians(2, 20, 24, 3, seed=3, layers=2))
    yield Case("layers", "two layers with their own k, the second's intrinsics those of CAMS, scaled", data)
    odd = make_smooth_gaussians(2, 12, 16, 0, layers=2)
    other = replace(odd.extra_layers[0], cameras=make_skewed_cameras(2, *odd.extra_layers[0].opacities.shape[1:]))
    yield Case("intrinsics", "a second layer with intrinsics of its own", compress(replace(odd, extra_layers=(other,))))
    yield Case("max_odd", "13x21: padding", compress(make_smooth_gaussians(1, 13, 21, 1), "max"))
    yield Case("max_coarse", "Q_g 24", compress(make_smooth_gaussians(1, 17, 18, 1), "max", 24), scale=4.0)
    yield Case("row", "1x33: the least coded height", compress(make_smooth_gaussians(1, 1, 33, 0, seed=4)))
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
    yield Case("rough_pose", "c2w 2e-4 off a rotation: the nearest one", roughened(text, 2e-4))


def zero_rotation(data: bytes) -> bytes:
    """The file with every constant of its rotations at 0."""

    def change(text: bytearray) -> None:
        for number, row in enumerate(Pict.of(data).rows):
            if row[1] == 4 and row[3] == 255:
                text[6 + 12 * number + 8 : 6 + 12 * number + 12] = bytes(4)

    return changed_section(data, b"PICT", change)


def roughened(data: bytes, by: float) -> bytes:
    """The file with an entry of its first camera's rotation moved; all of the camera's columns hold one number."""

    def change(text: bytearray) -> None:
        at = 0
        for _ in range(7):
            at += 5 if text[at] & 2 else 9
        assert text[at] < 2
        (entry,) = struct.unpack_from("<d", text, at + 1)
        struct.pack_into("<d", text, at + 1, entry + by)

    return changed_section(data, b"CAMS", change)


def structure() -> Iterator[Case]:
    """Sections, the order of pictures, prefixes."""
    scene = make_smooth_gaussians(2, 16, 16, 1, seed=5, layers=2)
    scene = replace(scene, sh=scene.sh * np.array([1, 8, 8, 8], np.float32)[:, None])
    data = compress(scene)
    ends = [entry["bytes"] for entry in ts.inspect(data)["prefixes"]]
    yield Case("prefix", "colours behind the third that are not there", data, {"maxBytes": ends[-2]}, scale=1.0)
    yield Case("prefix_early", "no opacity: the mean; no second depth picture", data, {"maxBytes": ends[0]}, scale=1.0)
    first = len(data) - len(sections_of(data)[-1][3])
    hidden = first + Pict.of(data).places[0].length
    yield Case("prefix_hidden", "a view without depth", data, {"maxBytes": hidden}, scale=1.0)
    spoilt = bytearray(data)
    spoilt[ends[-1] - 5] ^= 16
    yield Case("recover", "a picture whose CRC differs, left out", bytes(spoilt), {"recover": True}, scale=1.0)
    small = make_smooth_gaussians(1, 6, 6, 0)
    noted = compress(small.with_notes(ts.Notes("metre", "Jörg Müller, Ελένη", "CC-BY-4.0", "20 steps", "yes")))

    def add(text: bytearray) -> None:
        text += struct.pack("<BH", 5, 3) + b"later" + b"yes"

    noted = changed_section(noted, b"NOTE", add)
    yield Case("notes", "texts of every field, and a field of no name that is known", noted)
    *metadata, pictures = sections_of(compress(small))
    later = file_of([*metadata[:2], [b"XTRA", 0, 3, b"of a later version"], *metadata[2:], pictures], minor=77)
    yield Case("unknown_section", "an optional section to skip, and another minor version", later)
    *metadata, pictures = sections_of(repacked(data, lambda rows: rows[::-1]))
    yield Case("any_order", "sections and rows the other way round", file_of([*metadata[::-1], pictures]))


def other_modes() -> Iterator[Case]:
    """Modes list, lossless and photos."""
    rng = np.random.default_rng(7)
    data = compress(make_list(300, 1, rng), keep_all=True)
    yield Case("list", "SH degree 1", data)
    far = compress(make_list(90, 3, rng, 40.0), qp=-6, keep_all=True)
    yield Case("list_degree3", "SH degree 3, radii far apart", far)
    yield Case("list_one", "one Gaussian", compress(make_list(1, 0, rng), keep_all=True))
    crowd = make_list(600, 0, rng, 0.0)
    yield Case("list_crowd", "600 in one place: numbers beyond a byte", compress(crowd, keep_all=True))
    end = ts.inspect(data)["prefixes"][0]["bytes"]
    yield Case("list_prefix", "a prefix that holds what sorts", data, {"maxBytes": end}, scale=1.0)
    tiers = list_in_tiers(make_list(400, 1, rng))
    yield Case("tiers", "three tiers", tiers)
    ends = [entry["bytes"] for entry in ts.inspect(tiers)["prefixes"]]
    yield Case("tiers_spheres", "a second tier without rotations", tiers, {"maxBytes": ends[3]}, scale=1.0)
    few = make_list(60, 0, np.random.default_rng(17))
    seen = compress(replace(few, viewpoints=tuple(make_skewed_cameras(3, 12, 16))), keep_all=True)
    yield Case("list_cameras", "cameras of the photos that Gaussians were made from", seen)
    yield Case("lossless", "exact planes, two layers", lossless(make_smooth_gaussians(2, 6, 9, 1, layers=2)))
    yield Case("photos", "mode photos, network sweep", photos(2), needs=("network",))
    yield Case("groups", "photos that the network is given in two groups", in_groups(), needs=("network",))


def photos(views: int) -> bytes:
    """A file of photos."""
    with TemporaryDirectory() as folder:
        scene = ts.load_scene(write_scene(Path(folder) / "scene", views=views, height=16, width=16))
        return ts.Runtime(threads=1).encode(scene, "sweep", "fast", mode="photos")


def in_groups(first: tuple[int, ...] = (0x8000, 0x8001), second: tuple[int, ...] = (1, 0x8002)) -> bytes:
    """A file of three photos, of which the network is given two at a time; bit 15 of a view says who keeps it."""

    def change(text: bytearray) -> None:
        text[122:] = struct.pack("<H", 2)
        for words in (first, second):
            text += struct.pack(f"<B{len(words)}H", len(words), *words)

    return changed_section(photos(3), b"PHOT", change)


def refused() -> Iterator[Case]:
    """Files that a reader must not accept."""
    data = compress(make_smooth_gaussians(2, 8, 8, 1, seed=8), "fast")
    sections = sections_of(data)
    listed = compress(make_list(40, 0, np.random.default_rng(9)), keep_all=True)
    exact = lossless(make_smooth_gaussians(1, 4, 4, 0))

    def made(name: str, tests: str, file: bytes, **options: Any) -> Case:
        return Case(f"refused_{name}", tests, file, refused=True, **options)

    def spoilt(name: str, tests: str, file: bytes, kind: bytes, at: int, value: bytes, index: int = 0) -> Case:
        return made(name, tests, changed_section(file, kind, poked(at, value), index))

    yield made("magic", "another magic", b"\x89TSPLOT\n" + data[8:])
    yield made("major", "major version 2", file_of(sections, 2))
    yield made("table_crc", "the table altered", data[:30] + bytes([data[30] ^ 1]) + data[31:])
    yield made("section_crc", "SCEN altered", data.replace(b"fast", b"fasd", 1))
    yield made("cut", "cut short", data[:-1])
    yield made("behind", "a byte behind the last section", data + b"\0")
    yield made("required", "an unknown section that is required", beside(data, [b"XTRA", 1, 0, b""]))
    yield made("other_mode", "a section LIST in a file of mode gaussians", beside(data, [b"LIST", 1, 0, b""]))
    yield made("last", "pictures in front of their table", file_of([*sections[:-2], sections[-1], sections[-2]]))
    yield made("pose", "a camera whose c2w is no rotation", roughened(compress(make_smooth_gaussians(1, 8, 8, 0)), 0.2))
    yield spoilt("column", "a column stored in a way that there is not", data, b"CAMS", 0, b"\4")
    yield spoilt("size", "a grid of 65536x65536", data, b"LAYR", 0, struct.pack("<II", 65536, 65536))
    yield spoilt("range", "a depth beyond float32", data, b"LAYR", 18, struct.pack("<f", 3e38))
    yield spoilt("row", "a picture of a layer that there is not", data, b"PICT", 6, b"\1")
    yield made("picture_crc", "a picture altered", data[:-3] + bytes([data[-3] ^ 1]) + data[-2:])
    metadata = len(data) - len(sections[-1][3])
    yield made("no_depth", "a prefix without any picture", data, options={"maxBytes": metadata + 9})
    larger = next(d for k, _, _, d in sections_of(compress(make_smooth_gaussians(1, 32, 8, 0), "fast")) if k == b"HEVC")
    other = [[k, f, i, larger if k == b"HEVC" else d] for k, f, i, d in sections]
    yield made("size_of_pictures", "pictures of another size", file_of(other))
    hidden = "\U00013439".encode()  # which Unicode 14 does not know
    note = struct.pack("<BH", 7, len(hidden)) + b"refined" + hidden
    yield made("note", "a note with a character that does not print", beside(data, [b"NOTE", 0, 0, note]))
    sets = next(d for k, _, _, d in sections if k == b"HEVC")
    long = [[k, f, i, sets.ljust(1025, b"\0") if k == b"HEVC" else d] for k, f, i, d in sections]
    yield made("sets", "1025 bytes of parameter sets", file_of(long))
    yield made("groups", "a group that keeps no photo", in_groups((0, 1)))
    yield spoilt("levels", "an octree with two roots", listed, b"TIER", 28, struct.pack("<I", 2))
    yield spoilt("count", "more Gaussians than bytes pay for", listed, b"TIER", 0, b"\0\0\1\0")
    place = next(place for place in Pict.of(listed).places if place.row[1] == 6)
    points = bytearray(sections_of(listed)[-1][3][place.start : place.start + place.length])
    points[24] = 0x7F
    yield made("points", "positions that are no LZMA2", with_picture(listed, place, bytes(points)))
    tiers = list_in_tiers(make_list(60, 0, np.random.default_rng(9)))
    yield spoilt("growth", "scales that grow by e^3", tiers, b"TIER", 24, b"\0\0\x40\x40", 1)
    yield spoilt("exact_hash", "exact planes of another SHA-256", exact, b"EXAC", 20, b"\0\0\0")
    yield spoilt("order", "an order of pictures that there is not", data, b"PICT", 4, b"\1")


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
        arrays = arrays_of(decode(case.data, **case.options))
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
