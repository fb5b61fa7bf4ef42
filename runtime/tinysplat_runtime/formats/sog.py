"""Points in SOG version 2: WebP pictures of a pixel a Gaussian beside a `meta.json`, in a folder or one zip file.

Positions are 16 bits, split over two pictures, of sign(x)·log(1 + |x|); rotations the three smallest components of wxyz
in 8 bits, the largest one's index in alpha; logarithms of scales, and SH of degree 0, bytes into codebooks of 256
values; higher SH bytes into a codebook for a palette of at most 65,536 vectors. Rows follow a Morton curve. Source:
developer.playcanvas.com, "The SOG Format", and github.com/playcanvas/splat-transform.

Version 1, which is read, too, has no `version`. Its bytes lie between `mins` and `maxs` in place of codebooks, by
channel but for SH, and alpha of degree 0 is a logit. Source: github.com/playcanvas/engine, `gsplat-sogs-data.js`.

A `lod-meta.json` names several such folders and, in a tree, the rows of them that show a place at each level of detail:
level 0 is the finest, and what is read.

Trust boundary: names of pictures must lie in the folder, and their sizes are held against the count before they are
decoded.
"""

import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..gaussian.curve import morton_order
from ..gaussian.gaussians import Gaussians
from ..gaussian.notes import YES
from ..gaussian.quaternions import from_smallest_three, normalize_quats, smallest_three
from ..scene.intake.fields import Fields
from ..system.files import is_plain_name, parsing, read_limited, stays_inside, write_atomically
from ..system.jsonfields import JsonObject, parse_object
from .assembly import Contents, PointCloud, WriteOptions, cut_degree_note, far_note, joined
from .palette import codebook, nearest, palette

META = "meta.json"
LEVELS = "lod-meta.json"
MODEL = "antialiased"
"""What `model` is called in `meta.json`, where it is there."""
MAX_DEGREE = 3

_MAX_META = 1 << 20
_MAX_LEVELS = 64 << 20
_MAX_NODES = 1 << 20
_MAX_SIDE = 16383  # of a WebP picture
_PALETTE_ROW = 64  # vectors beside each other in the picture of the palette
_MAX_PALETTE = 1 << 16
_TERMS = (0, 3, 8, 15)  # of SH above degree 0
_TAG = 252


# ---- out -----------------------------------------------------------------------------------------------------------


def save_sog(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """Write points as one zip file, or beside a `meta.json`; SH above degree MAX_DEGREE is left out.

    Args:
        path: a `.json` file has its pictures beside it, which are complete before it is.
        gaussians: of any shape.

    Returns:
        What is lost, one line each.

    Raises:
        InputError: more Gaussians than pictures have pixels.
        ImportError: Pillow is not installed.
    """
    points = PointCloud.of(gaussians)
    told = {"model": MODEL} if gaussians.notes.antialiased else {}
    *pictures, (_name, meta) = _files(points.gaussians, points.means, told)
    if path.suffix == ".json":
        for name, data in pictures:
            write_atomically(path.parent / name, data)
        path.write_bytes(meta)
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, data in [*pictures, (META, meta)]:
                archive.writestr(zipfile.ZipInfo(name), data)
    return [*cut_degree_note(gaussians, MAX_DEGREE, ".sog"), *far_note(points)]


def _files(gaussians: Gaussians, means: NDArray, told: Mapping[str, str]) -> list[tuple[str, bytes]]:
    """Names and contents of a SOG folder, `meta.json` last, of (N,) Gaussians and their world positions (N, 3).

    `told` is what `meta.json` says besides.
    """
    count = len(means)
    width = -(-int(np.ceil(np.sqrt(count))) // 4) * 4
    height = -(-count // (4 * width)) * 4
    if max(width, height) > _MAX_SIDE:
        raise InputError(f"{count} Gaussians, .sog holds {_MAX_SIDE**2}")
    order = morton_order(means)
    files: list[tuple[str, bytes]] = []

    def picture(name: str, columns: NDArray) -> str:
        pixels = np.zeros((height * width, 4), np.uint8)
        pixels[:, 3] = 255
        pixels[:count, : columns.shape[1]] = columns
        files.append((f"{name}.webp", _webp(pixels.reshape(height, width, 4))))
        return f"{name}.webp"

    logs = np.sign(means) * np.log1p(np.abs(means.astype(np.float64)))
    low, high = logs.min(axis=0), logs.max(axis=0)
    codes = np.rint((logs[order] - low) / np.where(high > low, high - low, 1) * 65535).astype(np.uint16)
    meta: JsonObject = {"version": 2, "asset": {"generator": "tinysplat"}, "count": count, **told}
    positions = [picture("means_l", (codes & 255).astype(np.uint8)), picture("means_u", (codes >> 8).astype(np.uint8))]
    meta["means"] = {"mins": low.tolist(), "maxs": high.tolist(), "files": positions}
    log_scales = np.log(gaussians.scales[order].clip(np.finfo(np.float32).tiny))
    levels = codebook(log_scales.ravel())
    meta["scales"] = {"codebook": levels.tolist(), "files": [picture("scales", nearest(log_scales, levels))]}
    meta["quats"] = {"files": [picture("quats", _packed_rotations(gaussians.quats[order]))]}
    constant = gaussians.sh[order, 0]
    levels = codebook(constant.ravel())
    opacity = np.rint(gaussians.opacities[order, None] * 255.0).astype(np.uint8)
    colours = np.concatenate([nearest(constant, levels), opacity], axis=1)
    meta["sh0"] = {"codebook": levels.tolist(), "files": [picture("sh0", colours)]}
    degree = min(gaussians.degree, MAX_DEGREE)
    if degree:
        meta["shN"] = _write_higher(gaussians.sh[order, 1 : (degree + 1) ** 2], degree, picture, files)
    return [*files, (META, json.dumps(meta).encode())]


def _write_higher(
    sh: NDArray, degree: int, picture: Callable[[str, NDArray], str], files: list[tuple[str, bytes]]
) -> JsonObject:
    """Pictures of the palette and of each Gaussian's index into it, of sh (N, B − 1, 3); their entry in `meta.json`."""
    terms = _TERMS[degree]
    size = min(_PALETTE_ROW, 1 << max(int(np.log2(max(len(sh) / 1024, 1))), 0)) * 1024
    vectors, labels = palette(sh.reshape(len(sh), -1), min(size, _MAX_PALETTE))
    levels = codebook(vectors.ravel())
    rows = -(-len(vectors) // _PALETTE_ROW)
    pixels = np.zeros((rows * _PALETTE_ROW, terms, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[: len(vectors), :, :3] = nearest(vectors, levels).reshape(-1, terms, 3)
    files.append(("shN_centroids.webp", _webp(pixels.reshape(rows, _PALETTE_ROW * terms, 4))))
    bytes_of_labels = labels.astype("<u2")[:, None].view(np.uint8)
    names = ["shN_centroids.webp", picture("shN_labels", np.pad(bytes_of_labels, ((0, 0), (0, 1))))]
    return {"count": len(vectors), "bands": degree, "codebook": levels.tolist(), "files": names}


def _packed_rotations(quats: NDArray) -> NDArray:
    largest, three = smallest_three(normalize_quats(quats.astype(np.float64)))
    codes = np.rint((three * np.sqrt(0.5) + 0.5) * 255).clip(0, 255)
    return np.concatenate([codes, (_TAG + largest)[:, None]], axis=1).astype(np.uint8)


def _webp(pixels: NDArray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "WEBP", lossless=True, exact=True, quality=60, method=2)
    return buffer.getvalue()


# ---- in ------------------------------------------------------------------------------------------------------------


def in_folder(path: Path) -> Path:
    """The file that a folder is read by, its `lod-meta.json` or `meta.json`; the path itself where there is neither."""
    documents = [path / name for name in (LEVELS, META) if (path / name).is_file()]
    return documents[0] if documents else path


def read_sog(path: Path, max_bytes: int) -> Contents:
    """Read a .sog file, the folder of a `meta.json`, or the finest level of a `lod-meta.json`.

    Returns:
        means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear, float64; and the one note
        that splat-transform's `meta.json` has a name for.

    Raises:
        InputError: damaged, of another version, or larger than `max_bytes`.
        ImportError: Pillow is not installed.
    """
    if path.name == LEVELS:
        return _read_levels(path, max_bytes), {}
    with _reading(path) as read:
        return _arrays(read, max_bytes)


def _read_levels(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """The rows that a `lod-meta.json` has for its finest level, and all of its `environment`."""
    meta = _document(read_limited(path, _MAX_LEVELS), LEVELS).values
    names, around = meta.get("filenames"), meta.get("environment")
    names = [*names, *([around] if around else [])] if isinstance(names, list) else []
    if not names or not all(isinstance(name, str) and 0 < len(name) < 1000 and stays_inside(name) for name in names):
        raise InputError("expected names of SOG files within the folder", where=f"{LEVELS}: filenames")
    rows = _finest(meta.get("tree"), len(names))
    if around:
        rows.setdefault(len(names) - 1, []).append(slice(None))
    parts: list[dict[str, NDArray]] = []
    left = max_bytes
    for index, pieces in sorted(rows.items()):
        file = in_folder(path.parent / names[index])
        with _reading(file) as read:
            arrays, _ = _arrays(read, left)
        for piece in pieces:
            part = {name: array[piece] for name, array in arrays.items()}
            left -= sum(array.nbytes for array in part.values())
            if left < 0 or (piece.stop or 0) > len(arrays["means"]):
                raise InputError(f"rows {piece.start} to {piece.stop}, which it does not have", where=names[index][:60])
            parts.append(part)
    return joined(parts)


def _finest(tree: Any, files: int) -> dict[int, list[slice]]:
    """Rows by file of every node's finest level."""
    rows: dict[int, list[slice]] = {}
    todo, visits = [tree], 0
    with parsing(LEVELS):
        while todo:
            node = todo.pop()
            todo += node.get("children") or ()
            visits += 1
            if visits + len(todo) > _MAX_NODES:
                raise InputError(f"more than {_MAX_NODES} nodes", where=LEVELS)
            levels = node.get("lods")
            if levels:
                piece = levels[min(levels, key=int)]
                index, start, count = (piece[name] for name in ("file", "offset", "count"))
                if not (0 <= index < files and start >= 0 and count >= 0):
                    raise InputError(f"file {index}, rows {start} and {count} more", where=LEVELS)
                rows.setdefault(int(index), []).append(slice(int(start), int(start) + int(count)))
    if not rows:
        raise InputError("a tree without rows", where=LEVELS)
    return rows


@contextmanager
def _reading(path: Path) -> Iterator[Callable[[str, int], bytes]]:
    """What gives a file of the folder or archive by its name, up to so many bytes."""
    if path.name == META:
        with parsing("SOG folder"):
            yield lambda name, limit: read_limited(path.parent / name, limit)
        return
    with parsing(".sog file"), zipfile.ZipFile(path) as archive:
        members = {PurePosixPath(info.filename).name: info for info in archive.infolist()}

        def member(name: str, limit: int) -> bytes:
            if name not in members:
                raise InputError(f"lacks {name[:40]}")
            info = members[name]
            if info.file_size > limit or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError(f"{info.file_size} bytes, expected at most {limit}", where=name[:40])
            return archive.read(info)

        yield member


def _arrays(read: Callable[[str, int], bytes], max_bytes: int) -> Contents:
    meta = _document(read(META, _MAX_META), META)
    version = meta.value("version", 1)
    if version not in (1, 2):
        raise InputError(f"{str(version)[:20]}, expected 1 or 2", where=meta.place("version"))
    is_first = version == 1
    means = meta.inside("means")
    count = next(iter(means.array("shape", (-1,)).tolist()), 0) if is_first else meta.whole("count")
    if not 1 <= count <= min(_MAX_SIDE**2, max_bytes // 100):
        raise InputError(f"count {count:g}, which {max_bytes} bytes cannot hold", where=META)
    count = int(count)

    def pixels(name: str, picture: int = 0) -> NDArray:
        flat = _picture(read, meta.inside(name), picture, count).reshape(-1, 4)
        if len(flat) < count:
            raise InputError(f"{len(flat)} pixels for {count} Gaussians", where=name)
        return flat[:count]

    def values(name: str, codes: NDArray) -> NDArray:
        """What bytes (N, C) stand for: of version 1 between limits of their channels, later from a codebook."""
        entry = meta.inside(name)
        return _between(entry, codes / 255.0) if is_first else entry.array("codebook", (256,))[codes[:, :3]]

    codes = pixels("means")[:, :3] + 256.0 * pixels("means", 1)[:, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # Gaussians will name what is not finite
        logs, colours = _between(means, codes / 65535), pixels("sh0")
        constant = values("sh0", colours)
        arrays = {
            "means": np.sign(logs) * np.expm1(np.abs(logs)),
            "quats": _unpacked_rotations(pixels("quats")),
            "scales": np.exp(values("scales", pixels("scales")[:, :3])),
            "opacities": 1 / (1 + np.exp(-constant[:, 3])) if is_first else colours[:, 3] / 255.0,
            "sh": np.concatenate([constant[:, None, :3], _read_higher(read, meta, count, pixels)], axis=1),
        }
    return arrays, {"antialiased": YES} if meta.values.get("model") == MODEL else {}


def _between(entry: Fields, shares: NDArray) -> NDArray:
    """Shares (N, C) of the way between the limits of their channels."""
    low, high = (entry.array(end, (shares.shape[1],)) for end in ("mins", "maxs"))
    return low + shares * (high - low)


def _read_higher(
    read: Callable[[str, int], bytes], meta: Fields, count: int, pixels: Callable[..., NDArray]
) -> NDArray:
    """(N, B − 1, 3)."""
    if "shN" not in meta.values:
        return np.zeros((count, 0, 3))
    entry = meta.inside("shN")
    is_first = "codebook" not in entry.values
    degree, size = (3, _MAX_PALETTE) if is_first else (entry.whole("bands"), entry.whole("count"))
    if degree not in (1, 2, 3) or not 1 <= size <= _MAX_PALETTE:
        raise InputError(f"degree {degree}, palette of {size}", where=entry.where)
    terms = _TERMS[degree]
    picture = _picture(read, entry, 0, _MAX_PALETTE * terms)
    if picture.shape[1] != _PALETTE_ROW * terms:
        fault = f"a palette {picture.shape[1]} pixels wide, expected {_PALETTE_ROW * terms}"
        raise InputError(fault, where=entry.where)
    codes = picture[..., :3].reshape(-1, terms, 3)
    if is_first:
        low, high = (entry.number(end) for end in ("mins", "maxs"))
        vectors = low + codes / 255.0 * (high - low)
    else:
        vectors = entry.array("codebook", (256,))[codes]
    labels = pixels("shN", 1)[:, :2] @ np.array([1, 256])
    if labels.max() >= len(vectors):
        raise InputError(f"index {labels.max()} into a palette of {len(vectors)}", where=entry.where)
    return vectors[labels]


def _unpacked_rotations(octets: NDArray) -> NDArray:
    largest = octets[:, 3].astype(np.int64) - _TAG
    if largest.min() < 0:
        raise InputError(f"tag {octets[:, 3].min()}, expected {_TAG} to 255", where="quats")
    return from_smallest_three(largest, (octets[:, :3] / 255.0 - 0.5) * np.sqrt(2))


def _picture(read: Callable[[str, int], bytes], entry: Fields, index: int, most: int) -> NDArray:
    """(h, w, 4) int64 of a picture of about `most` pixels at most."""
    from PIL import Image

    files = entry.values.get("files")
    name = files[index] if isinstance(files, list) and index < len(files) else None
    if not isinstance(name, str) or not is_plain_name(name):
        raise InputError(f"no plain name of picture {index}", where=entry.where)
    data = read(name, 8 * most + (1 << 16))
    with parsing("WebP picture"), Image.open(io.BytesIO(data), formats=["WEBP"]) as image:
        if image.width * image.height > 2 * most + 4096 or max(image.size) > _MAX_SIDE:
            raise InputError(f"{image.width}x{image.height} pixels, expected about {most}", where=name[:40])
        return np.asarray(image.convert("RGBA"), np.int64)


def _document(data: bytes, name: str) -> Fields:
    with within(name):
        return Fields(parse_object(data), name)
