"""What can be asked for: every option of `encode` and `compress`, stated here and nowhere else.

A value of one of these classes is right in itself: types, ranges, and that no two options contradict each other.
`EncodeRequest.of` takes options by name, flat, as command lines and manifests have them, some in words (`words`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Integral
from typing import TYPE_CHECKING, Any

from ..codec.modes import CHOICES, DEFAULT_MODE
from ..codec.profiles import DEFAULT_PROFILE, Profile, find_profile
from ..container.layout import MAX_FILE_BYTES
from ..errors import InputError
from ..gaussian.notes import OPTIONS, Notes
from ..graphs import DEFAULT_MODEL
from ..system.files import StrPath, read_limited
from . import words
from .types import check_types, shown
from .words import AutoViews, Refinement

if TYPE_CHECKING:
    from ..scene.scenes import Scene

RATE = ("qp", "target_size", "target_psnr", "lossless", "like")
"""Options that say how fine planes are coded; one of them at most."""


def rates_of(options: Mapping[str, Any]) -> list[str]:
    """Which options of `RATE` are given; 0 is a Q_g, while None and False say nothing."""
    return [name for name in RATE if options.get(name) is not None and options[name] is not False]


@dataclass(frozen=True)
class Coding:
    """How Gaussians become bytes.

    Attributes:
        profile: one of `codec.profiles.PROFILES`; None for the default.
        qp: Q_g; every quantiser step is multiplied by 2^(qp/6). None is 0, or what a target asks for.
        target_size: bytes of the file in place of `qp`: the largest file found of at most as many.
        target_psnr: dB of decoded against raw renders, the mean over the input views, or over four made up about
            Gaussians of no pixels, in place of `qp`: the smallest file found that has as many.
        lossless: float16 planes, bit for bit (`codec.exact` has the guarantee).
        like: a file's bytes or its path, whose profile, Q_g, maps, steps and QPs are taken, and whose pictures stay
            where nothing changed (`codec.recode`): a decoded scene coded again, edited or not, loses nothing else.
        mode: what the file of photos carries: gaussians, photos or auto (`codec.modes` says what they are).
        drop_invalid: make Gaussians at or behind their own camera transparent in place of refusing them.
        keep_all: of a list, all that show at all, in place of those alone that are worth their bytes.

    Raises:
        InputError: a value of another type or out of range, or two that contradict each other.
    """

    profile: str | None = None
    qp: float | None = None
    target_size: int | None = None
    target_psnr: float | None = None
    lossless: bool = False
    like: bytes | StrPath | None = None
    mode: str = DEFAULT_MODE
    drop_invalid: bool = False
    keep_all: bool = False

    def __post_init__(self) -> None:
        check_types(self)
        given = rates_of(vars(self))
        if len(given) > 1:
            raise InputError(f"given with {given[0]}, which contradicts it; expected one of them", where=given[1])
        size, psnr = self.target_size, self.target_psnr
        if size is not None and size < 1:
            raise InputError(f"{size} bytes, expected 1 or more", where="target_size")
        if psnr is not None and not 0 < psnr < 120:
            raise InputError(f"{psnr:g} dB, expected more than 0 and less than 120", where="target_psnr")
        if self.mode not in CHOICES:
            raise InputError(f"'{self.mode}', accepted are {', '.join(CHOICES)}", where="mode")
        if given and given != ["qp"]:
            if self.mode != DEFAULT_MODE:
                only = "with a target, lossless or like, which only gaussians can be given"
                raise InputError(f"'{self.mode}' {only}", where="mode")
            if self.profile is not None and given[0] in ("lossless", "like"):
                fault = f"given with {given[0]}, which leaves it no say; expected one of them"
                raise InputError(fault, where="profile")
        find_profile(self.profile or DEFAULT_PROFILE)
        if self.qp is not None:
            from ..codec.job import check_qp  # and with it numpy, which a default needs no more than a word does

            check_qp(self.qp)

    @property
    def planes(self) -> Profile:
        """The profile, chosen or not."""
        return find_profile(self.profile or DEFAULT_PROFILE)

    @property
    def step_qp(self) -> float:
        """Q_g, chosen or not."""
        return float(self.qp or 0)

    def example(self) -> bytes | None:
        """The bytes of `like`; InputError where it is a path that cannot be read."""
        return (
            self.like if self.like is None or isinstance(self.like, bytes) else read_limited(self.like, MAX_FILE_BYTES)
        )


COMPRESS_OPTIONS = tuple(one.name for one in fields(Coding) if one.name != "mode")
"""Options of `compress` by name: what codes Gaussians, which come with no photos that a mode could carry."""


def coding_of(**options: Any) -> Coding:
    """How `compress` is to code, of its options by name, some in words; errors as those of `Coding`."""
    return Coding(**_read(COMPRESS_OPTIONS, options))


@dataclass(frozen=True)
class EncodeRequest:
    """Photos to be made into a file, and how.

    Attributes:
        scene: a `Scene`; what `load_scene` takes; the two photos of a stereo pair; or a video.
        views: indices of photos, how many to choose, `all`, or None for all of up to six, else those that are needed.
        size: (height, width) to scale photos to, `full`, or None for at most about 640×480.
        near: smallest depth of interest in scene units, over the scene's own; None for that, or what photos show.
        far: the same of the largest.
        model: a network's name in the manifest, or the path of an .onnx file.
        focal: focal length of a stereo pair, in pixels.
        baseline: distance of its cameras.
        poses: of a video's frames: a RealEstate10K .txt, transforms.json, or a folder with these or a COLMAP model.
        first_number: what `poses` count from in names such as frame_00012.png: 0 or 1.
        coding: how the network's Gaussians become bytes.
        refinement: for how long they are corrected before; None as `refinement.chosen` has it, of 0 steps not at all.
        notes: what the file says of itself.

    Raises:
        InputError: a value of another type or out of range, or two that contradict each other.
    """

    scene: Scene | StrPath | Sequence[StrPath]
    views: tuple[int, ...] | AutoViews | str | None = None
    size: tuple[int, int] | str | None = None
    near: float | None = None
    far: float | None = None
    model: str = DEFAULT_MODEL
    focal: float | None = None
    baseline: float | None = None
    poses: StrPath | None = None
    first_number: int = 0
    coding: Coding = field(default_factory=Coding)
    refinement: Refinement | None = None
    notes: Notes = field(default_factory=Notes)

    def __post_init__(self) -> None:
        check_types(self)
        if not isinstance(self.views, AutoViews) and self.views not in (None, words.ALL):
            object.__setattr__(self, "views", _whole_numbers("views", self.views))
        if self.size is not None and self.size != "full":
            size = _whole_numbers("size", self.size)
            if len(size) != 2 or min(size) < 1:
                raise InputError(f"{shown(size)}, expected a height and a width of 1 or more", where="size")
            object.__setattr__(self, "size", size)
        if self.first_number not in (0, 1):
            raise InputError(f"{self.first_number}, expected 0 or 1", where="first_number")
        if self.refinement and self.coding.mode in ("photos", "auto"):
            only = f"with --mode {self.coding.mode}, whose files carry no Gaussians that were refined"
            raise InputError(only, where="refine")

    @classmethod
    def of(cls, scene: Scene | StrPath | Sequence[StrPath], **options: Any) -> EncodeRequest:
        """A request of `ENCODE_OPTIONS` by name, some in words; those that are left out keep their defaults.

        Raises:
            InputError: an option that there is not, and what the classes refuse.
        """
        given = _read(ENCODE_OPTIONS, options)
        refine = given.pop("refine", None)
        if isinstance(refine, bool):
            refine = Refinement(steps=None if refine else 0)
        elif isinstance(refine, Integral):
            refine = Refinement(steps=int(refine))
        if refine is not None and not isinstance(refine, Refinement):
            accepted = "steps such as 20, seconds such as 10s, auto or no"
            raise InputError(f"{shown(refine)}, expected {accepted}", where="refine")
        notes = Notes(**{name: text for name in OPTIONS if (text := given.pop(name, None)) is not None})
        coding = Coding(**{one.name: given.pop(one.name) for one in fields(Coding) if one.name in given})
        return cls(scene, coding=coding, refinement=refine, notes=notes, **given)


_PARTS = {"scene", "coding", "refinement", "notes"}

ENCODE_OPTIONS = (
    *(one.name for one in fields(EncodeRequest) if one.name not in _PARTS),
    *(one.name for one in fields(Coding) if one.name != "keep_all"),
    "refine",
    *OPTIONS,
)
"""Options of `encode` by name: the fields of `EncodeRequest`, `Coding` and `Notes`. Pixels of photos are all kept."""


def _whole_numbers(name: str, values: Any) -> tuple[int, ...]:
    """A list's whole numbers; InputError names the option."""
    is_list = isinstance(values, Sequence) and not isinstance(values, str | bytes)
    if not is_list or not all(isinstance(v, Integral) and not isinstance(v, bool) for v in values):
        raise InputError(f"{shown(values)}, expected a list of whole numbers", where=name)
    return tuple(int(value) for value in values)


def _read(accepted: Sequence[str], options: dict[str, Any]) -> dict[str, Any]:
    """Options by name with their words read; InputError for one that there is not."""
    unknown = sorted(set(options) - set(accepted))
    if unknown:
        raise InputError(f"unknown {', '.join(unknown)[:80]}, accepted are {', '.join(sorted(accepted))}")
    in_words = {
        "views": words.views,
        "size": words.size_or_full,
        "target_size": words.byte_count,
        "refine": words.refinement,
    }
    for name in in_words.keys() & options.keys():
        if isinstance(options[name], str):
            try:
                options[name] = in_words[name](options[name])
            except InputError as error:
                raise error.within(name) from None
    return options
