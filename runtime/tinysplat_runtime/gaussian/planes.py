"""Plane classes and the channels they consist of: the vocabulary of codec and container.

What a class is stands in `PLANE_CLASSES` and nowhere else: codec, container and the tables of docs/FORMAT.md follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # so that the command line can name profiles without numpy
    from numpy.typing import NDArray

MAX_DECODED = 1e30
"""Largest magnitude of a decoded number: sums and products of a few of them stay inside float32."""


class PlaneClass(IntEnum):
    """Class of a plane, or of what else a file's table of pictures lists; the number is the one in the file, by which
    records and their planes are ordered.
    """

    DEPTH = 0
    COLOR = 1
    OPACITY = 2
    SCALE = 3
    ROTATION = 4
    OFFSET = 5
    POSITION = 6
    EXACT = 7
    PHOTO = 8

    @property
    def label(self) -> str:
        """Lower-case name, as in reports."""
        return self.name.lower()

    @property
    def facts(self) -> ClassFacts:
        """What is to be known of a class of planes, which the last three are not."""
        return PLANE_CLASSES[self]


@dataclass(frozen=True)
class ClassFacts:
    """What is to be known of a plane class. Units are those of its planes (docs/CONVENTIONS.md, "Planes").

    Attributes:
        geometry: its channels of the geometry tensor (V, 11, H, W), first and behind the last; None for colour, whose
            channels are components of the SH coefficients.
        base, passes: the writer goes through all layers once per pass; the class's first `base` records stand in the
            first of its `passes`, the others in the second.
        flat: standard deviation below which a channel is constant but for float32's rounding, which a step relative to
            the deviation would code as noise at full cost; of depth as a share of its mean.
        largest: largest magnitude that a record may let it decode to.
        alpha, class_qp: steps per standard deviation and Q_c of arXiv 2506.09479's table.
        sensitivity: mean squared picture error per squared unit of error; None for depth, whose step is measured on
            the scene.
    """

    geometry: tuple[int, int] | None
    base: int
    passes: tuple[int, int]
    flat: float
    largest: float
    alpha: int
    class_qp: int
    sensitivity: float | None


PLANE_CLASSES: Mapping[PlaneClass, ClassFacts] = {
    PlaneClass.DEPTH: ClassFacts(
        geometry=(0, 1), base=1, passes=(0, 2), flat=1e-7, largest=MAX_DECODED,
        alpha=2048, class_qp=-4, sensitivity=None,
    ),
    PlaneClass.COLOR: ClassFacts(
        geometry=None, base=3, passes=(0, 3), flat=1e-5, largest=MAX_DECODED,
        alpha=1024, class_qp=3, sensitivity=0.035,
    ),
    PlaneClass.OPACITY: ClassFacts(
        geometry=(10, 11), base=1, passes=(1, 1), flat=1e-5, largest=MAX_DECODED,
        alpha=256, class_qp=0, sensitivity=4.5e-3,
    ),
    PlaneClass.SCALE: ClassFacts(
        geometry=(3, 6), base=3, passes=(1, 1), flat=1e-4, largest=MAX_DECODED,
        alpha=256, class_qp=0, sensitivity=9e-4,
    ),
    PlaneClass.ROTATION: ClassFacts(
        geometry=(6, 10), base=4, passes=(2, 2), flat=1e-5, largest=1e15,  # squares are summed
        alpha=256, class_qp=9, sensitivity=1.8e-4,
    ),
    PlaneClass.OFFSET: ClassFacts(
        geometry=(1, 3), base=2, passes=(2, 2), flat=1e-4, largest=MAX_DECODED,
        alpha=256, class_qp=12, sensitivity=2e-3,
    ),
}  # fmt: skip

CODING_ORDER = tuple(sorted(PLANE_CLASSES))
"""Classes by number: the order of records, and of planes within a pass."""

PASSES = tuple(sorted({number for facts in PLANE_CLASSES.values() for number in facts.passes}))
"""What the writer goes through all layers for: a base, how it covers, its refinement, what changes with the view.
Opacity and scale stand together, as either without the other shows worse than neither."""

BACK_TO_FRONT = 1
"""The pass that goes through the layers from the last: what the first reveals has to be there before it does."""

GEOMETRY: Mapping[PlaneClass, slice] = {
    plane_class: slice(*facts.geometry) for plane_class, facts in PLANE_CLASSES.items() if facts.geometry is not None
}
"""Channels of the geometry tensor (V, 11, H, W) by class."""

GEOMETRY_CHANNELS = max(channels.stop for channels in GEOMETRY.values())

BIT_DEPTH = 12
"""Of the pictures that planes are coded as."""

MAX_CODE = (1 << BIT_DEPTH) - 1

MAX_QP = 51
"""HEVC's largest QP."""

QP_BLOCK = 16
"""Side in pixels of the blocks that may have QPs of their own."""

MAX_QP_BLOCKS = 1024
"""Blocks of a plane that have one; in larger planes several `QP_BLOCK`s share theirs."""


def qp_block_side(height: int, width: int) -> int:
    """Side in pixels of the blocks of a plane that have QPs of their own: `QP_BLOCK`, doubled as long as they are too
    many.
    """
    side = QP_BLOCK
    while -(-height // side) * -(-width // side) > MAX_QP_BLOCKS:
        side *= 2
    return side


def hevc_step(qp: float) -> float:
    """HEVC's quantiser step in codes of `BIT_DEPTH` bits: 2^(b − 8) · 2^((QP − 4) / 6)."""
    return float(1 << (BIT_DEPTH - 8)) * 2 ** ((qp - 4) / 6)


@dataclass(frozen=True)
class Channel:
    """One kind of plane over all views of a layer, before quantisation.

    Attributes:
        plane_class: its class.
        target: which channel of the class it adds to (colour: which component).
        values: (V, H, W) float32 in the class's units.
        step: quantiser step of the video codec's transform coefficients, same units, > 0.
        window: smallest and largest value that will be represented; values outside are clipped and counted.
        offsets: (V, ceil(H / 16), ceil(W / 16)) int8 added to the QP by blocks of `QP_BLOCK` pixels, or None.
        flat_share: standard deviation, in steps, below which the channel is stored as a number.
    """

    plane_class: PlaneClass
    target: int
    values: NDArray
    step: float
    window: tuple[float, float]
    offsets: NDArray | None = None
    flat_share: float = 0.12

    @property
    def key(self) -> tuple[PlaneClass, int]:
        """Its class and target."""
        return self.plane_class, self.target

    @property
    def name(self) -> str:
        """For messages and reports, for instance `scale1`."""
        return f"{self.plane_class.label}{self.target}"


@dataclass(frozen=True)
class Reduction:
    """VABR's maps between SH coefficients and colour planes.

    Attributes:
        inverse: (d, k) float16, coefficients = inverse · planes; what the file stores.
        projection: (d, k) float64, planes = projectionᵀ · coefficients.
        energy_lost: share of the weighted energy that the k planes leave out.
        condition: condition number of the weighting Δ.
    """

    inverse: NDArray
    projection: NDArray
    energy_lost: float
    condition: float

    @property
    def k(self) -> int:
        """Number of colour planes."""
        return self.inverse.shape[1]


@dataclass(frozen=True)
class LayerPlan:
    """How one layer is to be coded: its channels, and how they map back to attributes.

    Attributes:
        channels: in coding order.
        degree: SH degree that is stored.
        depth_limits: smallest and largest z of the layer, scene units.
        inverse_depth: whether the depth channel holds −1/z in place of z.
        refine_depth: code the depth's coding error once more, at `depth_step`, in a second depth channel.
        reference_quats: (V, 4) float32 if rotations are vector parts relative to them, else None.
        scale_mix: (3, 3) float32 and (3,) float32, ŝ = mix · planes + mean, or None for the identity.
        reduction: VABR's maps, or None where colour planes are the three degree-0 coefficients themselves.
    """

    channels: tuple[Channel, ...]
    degree: int
    depth_limits: tuple[float, float]
    inverse_depth: bool = False
    refine_depth: float | None = None
    reference_quats: NDArray | None = None
    scale_mix: tuple[NDArray, NDArray] | None = None
    reduction: Reduction | None = None


def padded_size(height: int, width: int) -> tuple[int, int]:
    """Size at which a plane is coded: multiples of HEVC's minimum block of 8, and at least 16 as libx265 demands."""
    return max(16, -(-height // 8) * 8), max(16, -(-width // 8) * 8)
