"""What can be asked for: every option of `encode`, `compress`, `decode` and `convert`, stated here and nowhere else.

A value of one of these classes is right in itself: kinds, ranges, and that no two options contradict each other. Beside
each class stand the keywords that Python's functions take, with what each may be given as.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypedDict

from ..codec.profiles import DEFAULT_PROFILE, PROFILES, Profile, find_profile
from ..container.layout import MAX_FILE_BYTES
from ..errors import InputError, within
from ..formats import SH_BITS, SPZ_VERSION, SPZ_VERSIONS
from ..gaussian import MAP, OWN_VARIANCE, REMOVE
from ..gaussian.notes import Notes
from ..graphs import DEFAULT_MODEL
from ..modes import CHOICES, DEFAULT_MODE, LIST, PHOTOS
from ..scene import BACKGROUND, MOVING
from ..system import kinds
from ..system.files import StrPath, read_limited
from ..system.options import Options, flag, option
from . import words
from .words import AutoViews, Length, Training

if TYPE_CHECKING:
    from ..gaussian.gaussians import Gaussians
    from ..list.pruning.amount import Amount
    from ..scene.cameras import Camera
    from ..scene.scenes import Scene

VIDEO, HOW = "video, stereo, depth", "how files are written"
"""Groups of options that some callers do not offer."""

RATE = ("qp", "target_size", "target_psnr", "lossless", "like")
"""Options that say how fine planes are coded; one of them at most."""

PLANES_ALONE = "fast", "lossless", "like"
"""Options that say that photos become planes."""


class NoteKeywords(TypedDict, total=False):
    """What a file says of itself."""

    unit: str | None
    attribution: str | None
    licence: str | None


@dataclass(frozen=True, kw_only=True)
class Noted(Options, group="notes, kept in the file"):
    """What a file says of itself; an empty text takes back what the Gaussians said."""

    unit: str | None = option(kinds.text, metavar="TEXT", help="of lengths, such as metre")
    attribution: str | None = option(kinds.text, metavar="TEXT", help="author to name")
    licence: str | None = option(kinds.text, metavar="TEXT", help="such as CC-BY-4.0")

    def __post_init__(self) -> None:
        super().__post_init__()
        Notes(**self.notes)

    @property
    def notes(self) -> dict[str, str]:
        """Those that are given."""
        return {name: text for name in Noted.options() if (text := getattr(self, name)) is not None}


class CodingKeywords(TypedDict, total=False):
    """Of `compress` and `encode`, beside profile and qp."""

    target_size: int | str | None
    target_psnr: float | None
    lossless: bool
    like: bytes | StrPath | None
    drop_invalid: bool


@dataclass(frozen=True, kw_only=True)
class Coding(Options, group="bytes and quality"):
    """How Gaussians become bytes."""

    profile: str | None = option(
        kinds.text,
        metavar="P",
        choices=tuple(PROFILES),
        against=("lossless", "like"),
        help=f"{', '.join(PROFILES)}; default {DEFAULT_PROFILE}",
    )
    qp: float | None = option(kinds.number, metavar="Q", against=RATE, help="steps coarser by 2^(Q/6); default 0")
    target_size: int | None = option(
        kinds.byte_count, metavar="SIZE", against=RATE, help="at most 100KB, 1.5MB or so many bytes"
    )
    """The largest file found of at most as many bytes."""
    target_psnr: float | None = option(
        kinds.decibels, metavar="DB", against=RATE, help="smallest file of at least this PSNR"
    )
    """The smallest file found that has as many, as the mean over the input views; of a list over its error in eight
    views, beside its photos or about it."""
    lossless: bool = flag(against=RATE, help="float16 planes, bit for bit")
    """`codec.exact` has the guarantee."""
    like: bytes | StrPath | None = option(
        kinds.file, metavar="F.tsplat", against=RATE, help="reuse steps and unchanged pictures of this file"
    )
    """Its profile, Q_g, maps, steps and QPs are taken, and its pictures stay where nothing changed (`modes.recode`): a
    decoded scene coded again, edited or not, loses nothing else."""
    drop_invalid: bool = flag(help="hide Gaussians at or behind their camera")
    """Else they are refused."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.qp is not None:
            from ..codec.job import check_qp  # and with it numpy, which a default needs no more than a word does

            check_qp(self.qp)

    @property
    def rates(self) -> list[str]:
        """The options of `RATE` that are given."""
        return [name for name in self.given() if name in RATE]

    @property
    def planes(self) -> Profile:
        """The profile, chosen or not."""
        return find_profile(self.profile or DEFAULT_PROFILE)

    @property
    def step_qp(self) -> float:
        """Q_g, chosen or not."""
        return float(self.qp or 0)

    @property
    def is_usual(self) -> bool:
        """Whether nothing is asked for that changes a file's bytes."""
        return not any(getattr(self, name) for name in Coding.options())

    def example(self) -> bytes | None:
        """The bytes of `like`; InputError or FormatError where it is a path to no file that can be coded like."""
        if self.like is None or isinstance(self.like, bytes):
            return self.like
        from ..modes.recode import example

        data = read_limited(self.like, MAX_FILE_BYTES)
        with within(str(self.like)):
            example(data)
        return data


class EncodeKeywords(CodingKeywords, NoteKeywords, total=False):
    """Of `encode`, beside the model, profile and qp."""

    views: Sequence[int] | AutoViews | str | None
    size: tuple[int, int] | str | None
    near: float | None
    far: float | None
    masks: str | bool | None
    joint: bool
    mode: str | None
    fast: bool
    train: Training | int | str | None
    at_most: int | None
    poses: StrPath | None
    first_number: int
    focal: float | None
    baseline: float | None
    save_gaussians: StrPath | None


@dataclass(frozen=True, kw_only=True)
class Filmed(Options, group=VIDEO):
    """What photos alone do not say, and what is kept of their depth."""

    joint: bool = flag(True, off=False, help="", off_help="keep depths as the network finds them")
    """Whether all photos of a capture agree on depth; see `Runtime.predict`."""
    poses: StrPath | None = option(
        kinds.path, metavar="POSES", against=("focal", "baseline"), help="of a video: .txt, transforms.json, a folder"
    )
    """A RealEstate10K .txt, transforms.json, or a folder with these or a COLMAP model."""
    first_number: int = option(kinds.whole, 0, choices=(0, 1), help="of the first frame that POSES names; default 0")
    """What `poses` count from in names such as frame_00012.png."""
    near: float | None = option(kinds.number, metavar="Z", help="nearest depth; default: the scene's")
    """Scene units; None for the scene's own, or what photos show."""
    far: float | None = option(kinds.number, metavar="Z", help="farthest depth; default: the scene's")
    focal: float | None = option(kinds.number, metavar="PX", needs=("baseline",), help="of a stereo pair, in pixels")
    baseline: float | None = option(kinds.number, metavar="B", needs=("focal",), help="distance of its cameras")
    save_gaussians: StrPath | None = option(kinds.written, metavar="G.npz", help="also write the network's Gaussians")


@dataclass(frozen=True, kw_only=True)
class EncodeRequest(Filmed, Noted, Coding):
    """Photos to be made into a file, and how.

    Attributes:
        scene: a `Scene`; what `load_scene` takes; the two photos of a stereo pair; or a video.

    Raises:
        InputError: a value of another kind or out of range, or two that contradict each other.
    """

    scene: Scene | StrPath | Sequence[StrPath] = field(kw_only=False)
    views: tuple[int, ...] | AutoViews | str | None = option(
        words.views, metavar="I,J-K|auto[:N]|all", help="photos to take; default auto"
    )
    size: tuple[int, int] | str | None = option(
        words.size_or_full, metavar="WxH|full", help="of photos; default at most about 640x480"
    )
    """(height, width) in Python."""
    model: str = option(
        kinds.text, DEFAULT_MODEL, metavar="NAME|FILE.onnx", help="network; `tinysplat models` lists them"
    )
    masks: str | None = option(
        kinds.text,
        metavar="MEANING",
        choices=(MOVING, BACKGROUND, words.NO),
        off=words.NO,
        help=f"what masks hide: {MOVING} or {BACKGROUND}",
        off_help="ignore masks",
    )
    """None: mask files show what moves, transparent photos where nothing is; `scene.masks` has what that means."""
    mode: str | None = option(
        kinds.text, metavar="MODE", choices=CHOICES, help=f"what the file has: {', '.join(CHOICES)}; default by photos"
    )
    """`modes` says what they are; None as `recipe.kinds.chosen` has it."""
    fast: bool = flag(against=("mode",), help="leave the network's Gaussians: --mode gaussians, whatever the photos")
    train: Training | None = option(
        words.training, metavar="STEPS|60s", against=PLANES_ALONE, help="how long a list is trained; default: by photos"
    )
    at_most: int | None = option(
        kinds.count,
        metavar="N",
        against=PLANES_ALONE,
        help="Gaussians of a list; default: as many as photos show detail",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        of_list = [name for name in ("train", "at_most") if getattr(self, name) is not None]
        if of_list and self.mode not in (None, LIST):
            raise InputError(f"of a list, expected none with --mode {self.mode}", where=of_list[0])
        unfit = [name for name in self.rates if name != "qp" and (self.mode == PHOTOS or name in ("lossless", "like"))]
        if unfit and self.mode in (PHOTOS, LIST):
            option = unfit[0].replace("_", "-")
            raise InputError(f"'{self.mode}' with --{option}, expected --mode {DEFAULT_MODE}", where="mode")


class CompressKeywords(CodingKeywords, NoteKeywords, total=False):
    """Of `compress`, beside profile and qp."""

    keep_all: bool
    seconds: float | None
    cameras: Sequence[Camera] | StrPath | None


@dataclass(frozen=True, kw_only=True)
class CompressRequest(Noted, Coding):
    """Gaussians of any network, or of a trained scene, to be made into a file, and how.

    Attributes:
        gaussians: per pixel, with cameras, or a list.

    Raises:
        InputError: a value of another kind or out of range, or two that contradict each other.
    """

    gaussians: Gaussians = field(kw_only=False)
    keep_all: bool = flag(against=("seconds",), help="do not prune a trained scene")
    seconds: float | None = option(kinds.positive, metavar="S", help="time limit of pruning")
    """What was not looked at by then is kept, with a warning; bytes then depend on how fast the machine is."""
    cameras: Sequence[Camera] | StrPath | None = option(
        kinds.cameras, metavar="SCENE", help="cameras of its photos, to prune by"
    )
    """Of a list, in place of its viewpoints; where it has as many Gaussians as they have pixels, these."""


class ExportKeywords(NoteKeywords, total=False):
    """Of `convert`."""

    views: Sequence[int] | str | None
    trim_border: int | None
    min_opacity: float | None
    sh_degree: int | None
    prune: float | str | None
    keep_all: bool
    dilate: float | None
    points: bool
    sh_bits: Sequence[int] | str
    spz_version: int
    crop: Sequence[float] | str | None
    clean: str | bool | None
    level: bool
    length: Length | str | None
    rotate: Sequence[float] | str | None
    scale: float
    translate: Sequence[float] | str
    cameras: Sequence[Camera] | StrPath | None


@dataclass(frozen=True, kw_only=True)
class Upright(Options):
    """How a scene is placed in the world, by itself or by a length that was measured."""

    level: bool = flag(help="turn and shift it upright: y down, the ground at 0")
    length: Length | None = option(
        words.length, metavar="VIEW:U,V,U,V=0.74m", help="scale it to metres by a length in a view, or X,Y,Z,X,Y,Z=…"
    )
    """Between two pixels of a view, counted as in the file, or between two points."""


@dataclass(frozen=True, kw_only=True)
class Chosen(Options, group="which Gaussians"):
    """Which Gaussians are written."""

    views: tuple[int, ...] | None = option(
        kinds.indices, metavar="I,J-K", help="those of these views, such as 0,3,10-20"
    )
    trim_border: int | None = option(kinds.count, metavar="PX", help="without each view's outermost PX pixels")
    min_opacity: float | None = option(kinds.number, metavar="A", help="those of this opacity or more")
    sh_degree: int | None = option(kinds.whole, metavar="N", help="SH cut to this degree")
    prune: Amount | None = option(
        words.amount, metavar="SHARE|DB|N", help="drop 0.5, down to 45dB, or all but N (numba)"
    )
    """Those that pictures need least go first."""
    keep_all: bool = flag(help="do not prune a trained scene")
    """Lists also get the Gaussians of a capture that other views show, `.tsplat` files also those of a list that
    pictures hardly need."""
    dilate: float | None = option(
        kinds.positive,
        metavar="VARIANCE",
        usual=OWN_VARIANCE,
        help=f"widen for other viewers, pixels²; default {OWN_VARIANCE}",
    )
    """Own pixels² by which Gaussians are widened."""


@dataclass(frozen=True, kw_only=True)
class Filed(Options, group=HOW):
    """What the formats of files leave open."""

    points: bool = flag(only=".ply", help="a plain point cloud (.ply) of means and colours")
    sh_bits: tuple[int, int] = option(
        kinds.bits, SH_BITS, metavar="A,B", only=".spz", help=".spz: bits of SH of degree 1, above; 5,4"
    )
    spz_version: int = option(
        kinds.whole,
        SPZ_VERSION,
        metavar="N",
        choices=SPZ_VERSIONS,
        only=".spz",
        help="default 3; 4 keeps SH degree 4, wants zstd",
    )


@dataclass(frozen=True, kw_only=True)
class ExportRequest(Filed, Chosen, Noted, Upright):
    """What `convert` and `decode` do with Gaussians; of what is left out, nothing is done.

    Raises:
        InputError: a value of another kind or out of range.
    """

    crop: tuple[float, ...] | None = option(
        kinds.numbers(6), metavar="X,Y,Z,X,Y,Z", help="keep the box between two corners"
    )
    clean: str | None = option(
        kinds.text,
        metavar="map",
        usual=REMOVE,
        choices=(REMOVE, MAP),
        help="without floaters; map: with them in magenta (scipy)",
    )
    """Small groups of Gaussians that touch no others."""
    rotate: tuple[float, float, float, float] | None = option(
        words.turn, metavar="AXIS,DEG|W,X,Y,Z", help="first: x,90 or a quaternion"
    )
    scale: float = option(kinds.ratio, 1.0, metavar="S", help="then: enlarge the scene S times")
    translate: tuple[float, ...] = option(kinds.numbers(3), (0.0, 0.0, 0.0), metavar="X,Y,Z", help="then: move it")
    cameras: Sequence[Camera] | StrPath | None = option(
        kinds.cameras, metavar="SCENE", help="cameras of the photos, for --prune"
    )
    """Those of the photos that a list was made from, or what `load_cameras` reads."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length is not None and self.scale != 1:
            raise InputError("given with length, which says how much to enlarge; expected one of them", where="scale")


class SaveKeywords(ExportKeywords, CodingKeywords, total=False):
    """Of `save_gaussians`: of a `.tsplat` file those that code, too."""

    profile: str | None
    qp: float | None
