"""Named settings of the codec: what `--profile` chooses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..errors import InputError
from .hevc import EncoderSettings
from .planes import PlaneClass


@dataclass(frozen=True)
class PaperSettings:
    """The paper's quantisation (arXiv 2506.09479 and its table of α and Q_c).

    Attributes:
        alpha: 14-bit steps per standard deviation, by class.
        class_qp: Q_c by class.
        k: colour planes kept by VABR.
    """

    alpha: Mapping[PlaneClass, int]
    class_qp: Mapping[PlaneClass, int]
    k: int


@dataclass(frozen=True)
class AdaptiveSettings:
    """Steps of equal slope; see `allocation`.

    Attributes:
        windows: how many pieces of pictures errors are tried in; 0 to take the steps that measuring would start from.
        target: mean squared error of decoded against raw pictures aimed at at Q_g = 0.
        gain: coarseness of the steps that measuring starts from: gain / √sensitivity.
        sensitivity: mean squared picture error per squared unit of attribute error, by class; units of the planes.
        depth_step: step of inverse depth to start from, as a share of the mean inverse depth.
        energy_floor: colour planes are kept until the weighted energy left out falls below this share of a step².
        margin: octaves below its start that the colour step may fall to without losing components.
    """

    windows: int
    target: float
    gain: float
    sensitivity: Mapping[PlaneClass, float]
    depth_step: float
    energy_floor: float
    margin: float


@dataclass(frozen=True)
class Profile:
    """One of `PROFILES`."""

    name: str
    encoder: EncoderSettings
    settings: PaperSettings | AdaptiveSettings


PAPER = PaperSettings(
    alpha={
        PlaneClass.DEPTH: 2048,
        PlaneClass.OFFSET: 256,
        PlaneClass.SCALE: 256,
        PlaneClass.ROTATION: 256,
        PlaneClass.COLOR: 1024,
        PlaneClass.OPACITY: 256,
    },
    class_qp={
        PlaneClass.DEPTH: -4,
        PlaneClass.OFFSET: 12,
        PlaneClass.SCALE: 0,
        PlaneClass.ROTATION: 9,
        PlaneClass.COLOR: 3,
        PlaneClass.OPACITY: 0,
    },
    k=6,
)

ADAPTIVE = AdaptiveSettings(
    windows=2,
    target=6e-5,
    gain=0.009,
    sensitivity={
        PlaneClass.OFFSET: 1.15e-3,
        PlaneClass.SCALE: 4.5e-4,
        PlaneClass.ROTATION: 9e-5,
        PlaneClass.COLOR: 0.06,
        PlaneClass.OPACITY: 3.2e-3,
    },
    depth_step=4e-3,
    energy_floor=0.02,
    margin=1.0,
)

_PSYCHOVISION_OFF = ("psy-rd=0", "psy-rdoq=0")  # planes are looked at by no eye before synthesis

PROFILES: dict[str, Profile] = {
    profile.name: profile
    for profile in (
        Profile("paper", EncoderSettings("medium"), PAPER),
        Profile("fast", EncoderSettings("ultrafast", ("min-cu-size=8", *_PSYCHOVISION_OFF)), ADAPTIVE),
        Profile("balanced", EncoderSettings("superfast", ("rdoq-level=2", *_PSYCHOVISION_OFF)), ADAPTIVE),
        Profile(
            "max",
            EncoderSettings("veryslow", ("rdoq-level=2", *_PSYCHOVISION_OFF)),
            replace(ADAPTIVE, windows=8),
        ),
    )
}

DEFAULT_PROFILE = "balanced"


def find_profile(name: str) -> Profile:
    """The profile of that name; InputError lists those there are."""
    if name not in PROFILES:
        raise InputError(f"'{name}', accepted are {', '.join(PROFILES)}", where="profile")
    return PROFILES[name]
