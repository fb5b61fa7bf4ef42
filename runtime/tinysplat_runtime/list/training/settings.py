"""How a list is trained. Chosen on dev: docs/lab/training.md."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...errors import InputError
from . import FEW_PHOTOS
from .descent import Pace

PACE = Pace(log_scale=0.03, turn=0.01, sh=0.015, sh_rest=0.002, last=0.4, averaged=0.1)


@dataclass(frozen=True)
class Settings:
    """How Gaussians are drawn from pixels, added, dropped and corrected.

    Attributes:
        pace: how far a step goes.
        functions: SH functions of every Gaussian: 1, 4 or 9.
        structure: share of 1 − SSIM in what a photo lacks, the rest |error|.
        place: how far a photo's camera moves in a step, at the start, pixels; those of few photos stay.
        placed: share of the way after which cameras begin to move.
        alone, most_absent: how far the share of pixels that show what no other photo shows finer surpasses `alone` is
            the share of the Gaussians that are absent from a step, drawn anew in each; none at the start, all of it at
            the end, `most_absent` at most. So none relies on others to correct it where few photos would tell
            (DropGaussian, arXiv 2504.00773).
        quarter, half: shares of the way, at the beginning, on photos of a quarter and then of half their size.
        detail, overlap: how many Gaussians there may be, over the sum of the root of contrast over the surface's
            pixels; more where more than `overlap` photos show each, by the root of how many, as they tell finer detail,
            and by the same fewer where fewer do of few photos, which are soon overfitted.
        told: Gaussians per pixel of the photos that these can tell apart; there are no more, whatever their detail.
        crowded: how many times as many their detail has to ask for until each is to look different from every side.
        start: share of the Gaussians that it begins with.
        grown: share of the way after which none are added.
        looks: how often some are added and those that show nothing go.
        contradicted: mean |error| of a block of pixels, of three colours, from which on nothing is learnt from a photo
            there; not of few photos, of which one alone shows much.
        agreed: share of the way from which on that is looked for.
        texture: what a photo's smoothed contrast of grey counts where Gaussians are drawn, beside 1.
        larger: how much larger than their distance Gaussians begin.
        opacity: theirs at the beginning.
        added_size, added_opacity: of those that are added, own pixels and opacity.
        fade: by how much every logit of opacity falls in a step, at the start, times the root of the number of photos:
            as far as Adam moves on the mean what one of them alone asks for. So what no photo needs goes, as does most
            of what a single one is fitted by.
        faded: Gaussians of less opacity go.
        worth: squared error that a Gaussian has to save the photos, over the mean that is left of it by Gaussian; once
            none are added any more, those that save less go at every look.
        worth_of_few: the same of few photos, which lose more by it.
        spared: share of the Gaussians that goes at a look, at most, so that the others can make up for it.
    """

    pace: Pace = PACE
    functions: int = 4
    structure: float = 0.2
    place: float = 0.05
    placed: float = 0.1
    alone: float = 0.4
    most_absent: float = 0.3
    quarter: float = 0.25
    half: float = 0.4
    detail: float = 0.8
    overlap: float = 4.0
    told: float = 0.05
    crowded: float = 1.2
    start: float = 0.8
    grown: float = 0.6
    looks: int = 10
    contradicted: float = 0.6
    agreed: float = 0.25
    texture: float = 10.0
    larger: float = 1.5
    opacity: float = 0.6
    added_size: float = 1.2
    added_opacity: float = 0.5
    fade: float = 0.05
    faded: float = 0.02
    worth: float = 0.15
    worth_of_few: float = 0.03
    spared: float = 0.25

    def suited(self, photos: int, crowded: float) -> Settings:
        """These for so many photos, whose detail asks for so many times as many Gaussians as their pixels can tell: of
        many times, with colours of degree 2, as each has to look different from every side, and faster fading.
        """
        settings = replace(self, worth=self.worth_of_few) if photos <= FEW_PHOTOS else self
        return replace(settings, functions=9, fade=1.4 * self.fade) if crowded > self.crowded else settings

    def smaller(self, way: float) -> int:
        """How many times smaller photos are at a share of the way."""
        return 4 if way < self.quarter else 2 if way < self.quarter + self.half else 1


@dataclass(frozen=True)
class Budget:
    """How much training may make and take; None for what is usual.

    Attributes:
        gaussians: how many there may be at most; fewer are made where photos show less detail.
        size: bytes of the file that they are to be coded in, which fewer may fit better than coarser ones.
        steps: of so many photos. The same number gives the same result on any number of threads, unless seconds end
            them.
        seconds: fewer steps are planned as soon as it shows that they do not suffice; those in which kernels compile
            do not count.

    Raises:
        InputError: one of them is out of range.
    """

    gaussians: int | None = None
    steps: int | None = None
    seconds: float | None = None
    size: int | None = None

    def __post_init__(self) -> None:
        for name in ("gaussians", "steps", "size"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
                raise InputError(f"{value!r}, expected a whole number above 0", where=name)
        if self.seconds is not None and not 0 < self.seconds < 86_400:
            raise InputError(f"{self.seconds:g} s, expected more than 0 and less than a day", where="seconds")
