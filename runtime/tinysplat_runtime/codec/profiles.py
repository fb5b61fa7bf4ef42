"""Named settings of the codec: what `--profile` chooses. A profile is a row of `PROFILES`, and nothing else.

Loads without numpy and libx265, so that the command line can name what there is.
"""

from dataclasses import dataclass, replace

from ..errors import InputError


@dataclass(frozen=True)
class EncoderSettings:
    """What of libx265 a profile chooses.

    Attributes:
        preset: x265 preset.
        params: further x265 parameters as `name=value`.
        block_qps: whether blocks can have QPs of their own, which parameter sets say of all pictures.
    """

    preset: str
    params: tuple[str, ...] = ()
    block_qps: bool = False


@dataclass(frozen=True)
class PaperSettings:
    """The paper's quantisation (arXiv 2506.09479, with the α and Q_c of `PLANE_CLASSES`).

    Attributes:
        k: colour planes kept by VABR.
    """

    k: int


@dataclass(frozen=True)
class AdaptiveSettings:
    """Steps of equal slope; see `allocation`.

    Attributes:
        stripes: how many pieces of pictures errors of depth and opacity are tried in.
        rounds: measurements of depth, each at the step that the one before led to.
        depth_damage: mean squared error of the picture that depth may cause at Q_g = 0.
        opacity_damage: the same of opacity, whose step is made finer where it causes more.
        depth_step: step of inverse depth to start from, as a share of the mean inverse depth.
        gain: coarseness of the other steps: gain / √sensitivity, which `PLANE_CLASSES` has.
        width: mean standard deviation of the splats, in pixels, that the sensitivities of scale and rotation are for.
        behind: how much coarser than layer 0's those steps are in other layers, which mostly show at edges.
        energy_floor: colour planes are kept until the weighted energy left out falls below this share of a step².
        flat_share: standard deviation, in steps, below which a channel is stored as a number; what it holds may lie in
            few pixels, and show there.
        disagreement: one colour takes the place of all SH coefficients where input views see colours that differ by
            less than this share of a step² from it; see `one_colour`.
        margin: octaves below its start that the colour step may fall to without losing components.
    """

    stripes: int
    rounds: int
    depth_damage: float
    opacity_damage: float
    depth_step: float
    gain: float
    width: float
    behind: float
    energy_floor: float
    flat_share: float
    disagreement: float
    margin: float


@dataclass(frozen=True)
class Profile:
    """One of `PROFILES`.

    Attributes:
        name: that users choose it by.
        encoder: what of libx265 it chooses.
        settings: how planes of pixels are quantised.
        list_steps: steps of lists over those of other profiles at the same Q_g.
    """

    name: str
    encoder: EncoderSettings
    settings: PaperSettings | AdaptiveSettings
    list_steps: float = 1.0


ADAPTIVE = AdaptiveSettings(
    stripes=2,
    rounds=2,
    depth_damage=3.5e-5,
    opacity_damage=1.5e-5,
    depth_step=6e-3,
    gain=0.009,
    width=0.5,
    behind=1.41,
    energy_floor=0.005,
    flat_share=0.06,
    disagreement=0.2,
    margin=1.0,
)

_PSYCHOVISION_OFF = ("psy-rd=0", "psy-rdoq=0")  # planes are looked at by no eye before synthesis

PROFILES: dict[str, Profile] = {
    profile.name: profile
    for profile in (
        Profile("paper", EncoderSettings("medium"), PaperSettings(k=6)),
        Profile(
            "fast",
            EncoderSettings("ultrafast", ("min-cu-size=8", *_PSYCHOVISION_OFF), block_qps=True),
            replace(ADAPTIVE, rounds=1),
        ),
        Profile(
            "balanced", EncoderSettings("superfast", ("rdoq-level=2", *_PSYCHOVISION_OFF), block_qps=True), ADAPTIVE
        ),
        Profile(
            "max",
            # nothing that libx265's presets do beyond this makes intra pictures of planes smaller
            EncoderSettings("superfast", ("rd=6", "rdoq-level=2", *_PSYCHOVISION_OFF), block_qps=True),
            replace(ADAPTIVE, stripes=8, rounds=3),
            list_steps=0.55,  # a trained place then loses 0.05 dB at photos left out, not 0.1
        ),
    )
}

DEFAULT_PROFILE = "balanced"


def find_profile(name: str) -> Profile:
    """The profile of that name; InputError lists those there are."""
    if name not in PROFILES:
        raise InputError(f"'{name}', accepted are {', '.join(PROFILES)}", where="profile")
    return PROFILES[name]
