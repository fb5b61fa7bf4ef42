"""Damage to files with an inner structure that plain damage would only ever break at the surface.

Byte damage to JSON is a syntax error, to a zip archive a wrong checksum: neither reaches the code behind. Here the
surface stays intact and what it holds is damaged.
"""

import gzip
import io
import json
import struct
import zipfile
from copy import deepcopy
from random import Random
from typing import Any

from .damage import VALUES, damage

ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**400, 0.5, -0.0, 1e-320, 1e308, float("nan"), float("inf"), "", "0",
    "../../etc/passwd", "a\0b", "\ud800", "x" * 5000, [], [[]], [0] * 100, {}, {"": {}},
)  # fmt: skip
"""Values that a reader of JSON does not expect."""

_DEEP = 100_000


def damage_json(data: bytes, rng: Random) -> bytes:
    """A JSON document with a few of its nodes replaced, removed, doubled or moved; seldom nested without end."""
    if rng.random() < 0.02:
        return b"[" * _DEEP
    if rng.random() < 0.15:
        return damage(data, rng)
    document = json.loads(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        nodes = list(_nodes(document))
        parent, key = rng.choice(nodes)
        match rng.randrange(5):
            case 0:
                del parent[key]
            case 1:
                other, other_key = rng.choice(nodes)
                parent[key] = deepcopy(other[other_key])
            case _:
                parent[key] = deepcopy(rng.choice(ODD))
        if not isinstance(document, dict) or not document:
            break
    return json.dumps(document).encode()


def _nodes(value: Any) -> Any:
    """(container, key) of every node below a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        yield value, key
        yield from _nodes(child)


def damage_npz(data: bytes, rng: Random) -> bytes:
    """An .npz with damaged members under right checksums; sometimes the archive itself is damaged."""
    if rng.random() < 0.3:
        return damage(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    for _ in range(rng.choice((1, 1, 2))):
        name = rng.choice(list(members))
        match rng.randrange(5):
            case 0:
                members[rng.choice((name, "means.npy", "layer9999_means.npy", "../x.npy", "K.npy"))] = members.pop(name)
            case 1:
                members[name] = _damage_npy_header(members[name], rng)
            case 2:
                members[name] = members[rng.choice(list(members))]
            case _:
                members[name] = damage(members[name], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def _damage_npy_header(member: bytes, rng: Random) -> bytes:
    """Another type or shape than the bytes behind it have."""
    end = 10 + struct.unpack_from("<H", member, 8)[0]
    descr = rng.choice(("<f4", ">f8", "<f2", "|O", "<c8", "|V900", "<f16", "|S3", "<M8[s]", "[('a', '<f4')]"))
    side = rng.choice((0, 1, 2, 3, 65535, 2**31, 2**62, 2**70, -1))
    shape = tuple(side for _ in range(rng.choice((0, 1, 3, 4, 5, 40))))
    header = (
        f"{{'descr': {descr if descr.startswith('[') else repr(descr)}, 'fortran_order': False, 'shape': {shape}, }}"
    )
    padded = header.encode().ljust(117) + b"\n"
    return member[:8] + struct.pack("<H", len(padded)) + padded + member[end:]


def damage_safetensors(data: bytes, rng: Random) -> bytes:
    """A .safetensors file whose JSON header is damaged and whose length in front of it follows."""
    if rng.random() < 0.3:
        return damage(data, rng)
    (length,) = struct.unpack_from("<Q", data)
    header = damage_json(data[8 : 8 + length], rng) if rng.random() < 0.7 else data[8 : 8 + length]
    body = damage(data[8 + length :], rng) if rng.random() < 0.5 else data[8 + length :]
    stated = len(header) if rng.random() < 0.9 else rng.choice((0, 1, 2**32, 2**63 - 1, 2**64 - 1))
    return struct.pack("<Q", stated) + header + body


_TOKENS = (
    b"", b"-1", b"0", b"1", b"nan", b"-inf", b"1e400", b"1e-320", b"2147483648", b"18446744073709551616", b"x" * 3000,
    b"PINHOLE", b"OPENCV_FISHEYE", b"SIMPLE_RADIAL", b"EQUIRECTANGULAR", b"../../etc/passwd", b"/etc/passwd", b"#",
    b"\xff\xfe", b"9" * 400, b"1 2 3",
)  # fmt: skip
"""Words that a reader of text does not expect."""


def damage_text(data: bytes, rng: Random) -> bytes:
    """A text of lines and words: some replaced, removed, doubled or moved; sometimes plain damage."""
    if rng.random() < 0.15:
        return damage(data, rng)
    lines = data.split(b"\n")
    for _ in range(rng.choice((1, 1, 2, 4))):
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(6):
            case 0 if len(lines) > 1:
                del lines[i]
            case 1:
                lines.insert(j, lines[i])
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
            case _:
                words = lines[i].split(b" ")
                k = rng.randrange(len(words))
                words[k : k + 1] = rng.choice(((rng.choice(_TOKENS),), (rng.choice(_TOKENS),), (), (words[k],) * 2))
                lines[i] = b" ".join(words)
    return b"\n".join(lines)


def damage_ply(data: bytes, rng: Random) -> bytes:
    """A .ply whose header lines are damaged, doubled, removed or shuffled; sometimes its points."""
    end = data.index(b"end_header\n") + len(b"end_header\n")
    if rng.random() < 0.2:
        return damage(data[:end], rng) + data[end:]
    if rng.random() < 0.3:
        return data[:end] + damage(data[end:], rng)
    lines = data[:end].split(b"\n")
    for _ in range(rng.choice((1, 1, 2))):
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(6):
            case 0:
                del lines[i]
            case 1:
                lines.insert(j, lines[i])
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
            case 3:
                count = rng.choice((b"0", b"-1", b"1", b"4294967296", b"9" * 18, b"9" * 40, b"1e9"))
                lines = [b"element vertex " + count if line.startswith(b"element") else line for line in lines]
            case 4:
                kind = rng.choice((b"list uchar int", b"list double float", b"double", b"char", b"uint128"))
                lines[i] = b"property " + kind + b" " + rng.choice((b"x", b"opacity", b"f_rest_999", b"rot_0"))
            case _:
                formats = (b"ascii 1.0", b"binary_big_endian 1.0", b"binary_little_endian 2.0")
                lines = [b"format " + rng.choice(formats) if line.startswith(b"format") else line for line in lines]
        if not lines:
            break
    return b"\n".join(lines) + data[end:]


def damage_spz(data: bytes, rng: Random) -> bytes:
    """An SPZ file damaged as a whole or, where it is a gzip stream, inside of it, so that the stream stays intact."""
    if data[:2] != b"\x1f\x8b" or rng.random() < 0.3:
        return damage(data, rng)
    body = bytearray(gzip.decompress(data))
    if rng.random() < 0.5:  # a field of the header: magic, version, points, degree, fractional bits, flags, reserved
        at, width = rng.choice(((0, 4), (4, 4), (8, 4), (8, 4), (12, 1), (13, 1), (14, 1), (15, 1)))
        body[at : at + width] = rng.choice(VALUES[width])
    damaged = damage(bytes(body), rng) if rng.random() < 0.6 else bytes(body)
    return gzip.compress(damaged, compresslevel=1, mtime=0)


def damage_glb(data: bytes, rng: Random) -> bytes:
    """A .glb whose JSON is damaged under right lengths, or its values, or its header."""
    if rng.random() < 0.2:
        return damage(data, rng)
    (length,) = struct.unpack_from("<I", data, 12)
    text = damage_json(data[20 : 20 + length], rng)
    text += b" " * (-len(text) % 4)
    rest = damage(data[20 + length :], rng) if rng.random() < 0.3 else data[20 + length :]
    total = 20 + len(text) + len(rest)
    return struct.pack("<4sIIII", b"glTF", 2, total, len(text), 0x4E4F534A) + text + rest


def damage_glb_spz(data: bytes, rng: Random) -> bytes:
    """A .glb with SPZ in its first buffer view: its JSON damaged, or the SPZ under right lengths, or both."""
    if rng.random() < 0.4:
        return damage_glb(data, rng)
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    view, binary = document["bufferViews"][0], data[28 + length :]
    spoilt = damage_spz(binary[: view["byteLength"]], rng)
    view["byteLength"] = len(spoilt)
    spoilt += b"\0" * (-len(spoilt) % 4)
    document["buffers"][0]["byteLength"] = len(spoilt)
    text = json.dumps(document).encode()
    if rng.random() < 0.2:
        text = damage_json(text, rng)
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(spoilt), len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(spoilt), 0x004E4942) + spoilt


def damage_sog(data: bytes, rng: Random) -> bytes:
    """A bundle with a damaged `meta.json`, or pictures damaged, swapped or left out, under right checksums."""
    if rng.random() < 0.2:
        return damage(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    if rng.random() < 0.6:
        members["meta.json"] = damage_json(members["meta.json"], rng)
    name = rng.choice(list(members))
    match rng.randrange(4):
        case 0:
            members[name] = damage(members[name], rng)
        case 1:
            members[name] = members[rng.choice(list(members))]
        case 2:
            members[rng.choice(("../x.webp", "meta.json", "quats.webp"))] = members.pop(name)
        case _:
            pass
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()
