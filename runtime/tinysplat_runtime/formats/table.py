"""The formats of Gaussian files: what each is, who reads and writes it, and the two doors `load_gaussians` and
`save_gaussians`.

A format is a module beside this one, loaded when it is used, and a row of FORMATS. Its reader gives arrays, from which
`assembly` makes Gaussians; its writer takes Gaussians of any shape and says what it could not keep. But for .npz and
.safetensors, none knows pixels or layers: all layers become one list, and a list becomes a grid
again where its order is given.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..container.layout import MAGIC, SUFFIX
from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
from ..gaussian.notes import NAMES, Notes
from ..scene.cameras import Camera
from ..system.files import StrPath, atomic_path, check_readable
from . import SH_BITS, SPZ_VERSION
from .assembly import Contents, WriteOptions
from .viewpoints import cameras_beside

MAX_BYTES = 8 << 30
"""Most memory that the arrays of one file may take: 24 million Gaussians of SH degree 4."""


@dataclass(frozen=True)
class Format:
    """A Gaussian file format.

    Attributes:
        name: what people call it.
        endings: of files' names, lower case; the longest that fits decides.
        keeps: what survives, in a few words.
        checked: the program that is not ours which reads or writes it in the tests, or in checks/.
        extra: what `pip install "tinysplat[…]"` brings its package, empty where it needs none.
        read: (path, most bytes) to arrays and fields of `Notes`; None where it is only written.
        write: (path, Gaussians, options) to what could not be kept; None where it is only read.
        room: names of the notes that there is room for.
    """

    name: str
    endings: tuple[str, ...]
    keeps: str
    checked: str
    extra: str = ""
    read: Callable[[Path, int], Contents] | None = None
    write: Callable[[Path, Gaussians, WriteOptions], list[str]] | None = None
    room: tuple[str, ...] = NAMES


def _from(place: str) -> Callable[..., Any]:
    """The function at a place such as `ply.read_ply`, whose module is loaded when it is called."""
    module, _, name = place.partition(".")
    return lambda *arguments: getattr(importlib.import_module(f".{module}", __package__), name)(*arguments)


FORMATS = (
    Format(
        "npz", (".npz",), "everything, exactly", "numpy", "",
        _from("arrays.read_npz"), _from("arrays.write_npz"),
    ),
    Format(
        "safetensors", (".safetensors",), "everything, exactly", "safetensors", "io",
        _from("arrays.read_safetensors"), _from("arrays.write_safetensors"),
    ),
    Format(
        "compressed PLY", (".compressed.ply",), "a list; 8 to 11 bits of their chunk's range, SH to degree 3",
        "gaussforge", "io",
        _from("ply.read_ply"), _from("compressed_ply.save_compressed_ply"),
    ),
    Format(
        "PLY (3DGS)", (".ply",), "a list, float, SH to degree 3", "plyfile, splat-transform", "io",
        _from("ply.read_ply"), _from("ply.save_ply"),
    ),
    Format(
        "SPZ", (".spz",), "a list, 24-bit positions, bytes, SH to degree 3 (4 in version 4)",
        "gaussforge, splat-transform", "io",
        _from("spz.read_spz"), _from("spz.write_spz"), ("antialiased",),
    ),
    Format(
        "glTF", (".glb", ".gltf"), "a list, float, SH to degree 3; cameras, origin, notes",
        "three.js, Babylon.js, CesiumJS", "",
        _from("gltf_reader.read_gltf"), _from("gltf.write_gltf"),
    ),
    Format(
        "SOG", (".sog", "meta.json"), "a list, 16-bit positions, codebooks, SH to degree 3 from a palette",
        "gaussforge", "io",
        _from("sog.read_sog"), _from("sog.save_sog"), ("antialiased",),
    ),
    Format(
        "USD", (".usd", ".usda", ".usdc", ".usdz"), "a list, float, SH to degree 4, origin, notes",
        "usd-core", "usd",
        _from("usd.read_usd"), _from("usd.write_usd"),
    ),
    Format("splat", (".splat",), "a list, bytes, one colour", "gaussforge", "", _from("splat.read_splat")),
)  # fmt: skip

_ARCHIVE = "an archive: unpack it first and name the file in it"
_CONVERTED = "not read; splat-transform (npm, @playcanvas/splat-transform) converts it to .ply"

NOT_READ = dict.fromkeys((".zip", ".gz", ".7z", ".rar", ".tar", ".tgz", ".xz", ".zst"), _ARCHIVE) | {
    ".ksplat": _CONVERTED,
    ".lcc": _CONVERTED,
    ".splatv": "a scene that moves, of which no format here keeps more than a moment; export one as .ply",
    ".pt": "a checkpoint of PyTorch: export .ply with the tool that trained it",
    ".pth": "a checkpoint of PyTorch: export .ply with the tool that trained it",
    ".ckpt": "a checkpoint of PyTorch: export .ply with the tool that trained it (`ns-export gaussian-splat`)",
}
"""Endings of files in which Gaussians are, too, and what to do with them."""


def endings(*, written: bool) -> tuple[str, ...]:
    """Endings of the files that are read, or written."""
    chosen = [form for form in FORMATS if (form.write if written else form.read) is not None]
    return tuple(ending for form in chosen for ending in form.endings)


def ending_of(data: bytes) -> str | None:
    """The ending that a file's first bytes ask for, at least 64 of them; None where they tell none."""
    if data.startswith(b"PK"):  # the name of what a zip archive holds first
        first = data[30 : 30 + int.from_bytes(data[26:28], "little")]
        return ".npz" if first.endswith(b".npy") else ".usdz" if b".usd" in first else ".sog"
    starts = {b"ply": ".ply", b"\x1f\x8b": ".spz", b"NGSP": ".spz", b"glTF": ".glb", MAGIC: SUFFIX}
    ending = next((ending for start, ending in starts.items() if data.startswith(start)), None)
    return ".safetensors" if ending is None and data[8:9] == b"{" else ending


def find_format(path: StrPath, *, written: bool) -> Format:
    """The format that a file's name tells; InputError where it is none that is read, or written."""
    name = Path(path).name.lower()
    accepted = endings(written=written)
    fitting = [ending for ending in accepted if name.endswith(ending)]
    if not fitting and Path(path).is_dir():
        fault = "a folder, expected a file; `tinysplat encode` makes one of a scene"
        raise InputError(fault, where=str(path))
    if not fitting and not written and (how := NOT_READ.get(Path(path).suffix.lower())):
        raise InputError(how, where=str(path))
    if not fitting:
        raise InputError(f"suffix '{Path(path).suffix.lower()}', expected {', '.join(accepted)}", where=str(path))
    ending = max(fitting, key=len)
    return next(form for form in FORMATS if ending in form.endings)


def load_gaussians(
    path: StrPath,
    grid: tuple[int, int, int] | None = None,
    cameras: Sequence[Camera] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Gaussians:
    """Read a Gaussian file.

    Args:
        path: its ending tells the format, one of FORMATS.
        grid: (V, H, W) that a list is the pixels of, in C order.
        cameras: one per view, for files that hold none; they state the grid as well.
        max_bytes: most memory that the file's arrays may take.

    Raises:
        InputError: names the file and the array: missing, damaged, too large, of another shape, out of range.
    """
    from .activation import activation_doubts
    from .assembly import assemble, without_invalid

    path = Path(path)
    if path.is_dir():
        from .sog import in_folder

        path = in_folder(path)
    form = find_format(path, written=False)
    check_readable(path)
    if cameras and grid is None:
        grid = (len(cameras), cameras[0].height, cameras[0].width)
    if grid is not None and (len(grid) != 3 or min(grid) < 1):
        raise InputError(f"{tuple(grid)}, expected (V, H, W), each at least 1", where="grid")
    assert form.read is not None  # find_format
    try:
        if not path.stat().st_size:
            raise InputError(f"an empty file, expected {form.name}")
        (arrays, notes), invalid = form.read(path, max_bytes), 0
        for doubt in activation_doubts(arrays):
            warn(f"{path}: {doubt}")
        if grid is None:
            arrays, invalid = without_invalid(arrays)
        gaussians = assemble(arrays, grid, cameras)
        if not gaussians.is_per_pixel and not gaussians.viewpoints:
            gaussians = replace(gaussians, viewpoints=cameras_beside(path))
        if invalid:
            fault = "hold NaN, infinity or a rotation of zero and are left out"
            warn(f"{path}: {invalid} of {invalid + gaussians.count} Gaussians {fault}")
        return gaussians.with_notes(Notes(**notes))
    except ImportError:
        raise _missing_package(path, form) from None
    except InputError as error:
        with path.open("rb") as file:
            told = ending_of(file.read(64))
        if told is None or path.name.lower().endswith(told) or told in form.endings:
            raise error.within(str(path)) from None
        raise InputError(
            f"begins as {told} files do, expected {form.name}; give it that ending", where=str(path)
        ) from None


def save_gaussians(
    path: StrPath, gaussians: Gaussians, sh_bits: tuple[int, int] = SH_BITS, spz_version: int = SPZ_VERSION
) -> list[str]:
    """Write a Gaussian file, atomically.

    .npz and .safetensors keep everything and read back exactly.

    Args:
        path: its ending tells the format, one of FORMATS.
        gaussians: any, with any number of layers.
        sh_bits, spz_version: see `WriteOptions`.

    Returns:
        What the format could not keep or other readers may not expect, one line each; empty when there is nothing.

    Raises:
        InputError: another ending, or the package for the format is missing.
        OSError: the file cannot be written.
    """
    if not all(1 <= bits <= 8 for bits in sh_bits):
        raise InputError(f"{sh_bits}, expected two numbers of 1 to 8", where="SH bits")
    if isinstance(path, Gaussians) or not isinstance(gaussians, Gaussians):
        fault = f"a {type(path).__name__} and a {type(gaussians).__name__}, expected a path and then Gaussians"
        raise InputError(fault, where="save_gaussians")
    form = find_format(path, written=True)
    assert form.write is not None  # find_format
    unsaid = [name for name in gaussians.notes.given() if name not in form.room]
    lost = [f"notes left out, for which {form.endings[0]} has no room: {', '.join(unsaid)}"] if unsaid else []
    try:
        with atomic_path(path) as temporary:
            return [*form.write(temporary, gaussians, WriteOptions(sh_bits, spz_version)), *lost]
    except ImportError:
        raise _missing_package(path, form) from None
    except InputError as error:
        raise error if error.where and error.where.startswith(str(path)) else error.within(str(path)) from None


def save_points(path: StrPath, gaussians: Gaussians) -> None:
    """Write means and view-independent colours as a plain point cloud (.ply), atomically.

    Raises:
        InputError: another suffix, or plyfile is missing.
    """
    if Path(path).suffix.lower() != ".ply":
        raise InputError(f"suffix '{Path(path).suffix.lower()}', expected .ply", where=str(path))
    from .ply import write_points

    try:
        with atomic_path(path) as temporary:
            write_points(temporary, gaussians)
    except ImportError:
        raise _missing_package(path, find_format("points.ply", written=True)) from None


def _missing_package(path: StrPath, form: Format) -> InputError:
    return InputError(
        f'{form.name} needs a package that is not installed: pip install "tinysplat[{form.extra}]"', where=str(path)
    )
