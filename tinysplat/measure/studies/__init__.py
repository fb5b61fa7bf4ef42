"""Questions: what each measures, and the tables and plots that answer it. No study imports another.

STUDIES is the one place that lists them, by the words of `tinysplat bench`; a study is imported when it is asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..study import Study

STUDIES: dict[str, tuple[str, str]] = {
    "formats": ("interchange.INTERCHANGE", "bytes and dB of one scene in every format of Gaussian files"),
    "free": ("freed.FREE", "lists, a user's files or a made scene, in .tsplat and other formats"),
    "growth": ("growth.GROWTH", "seconds and memory by pixels of photos, photos of captures, Gaussians of clouds"),
    "waits": ("waiting.WAITING", "what users wait for, and commands beside those of another checkout (--beside)"),
    "curves": ("rate.CURVES", "rate–distortion of profiles"),
    "paper": ("paper.PAPER", "the paper's tables, ours beside"),
    "refined": ("refining.REFINED", "held-out dB by bytes, refined and unrefined"),
    "walk": ("walking.WALK", "whole captures: photos left out, drawn from 12, 24 and 48 others"),
    "pruned": ("pruned.PRUNED", "captures as one list: what pruning costs and saves, with cameras and without"),
    "poses": ("placing.PLACING", "photos placed without their cameras, and how many of them right"),
    "quality": ("quality.QUALITY", "pictures of networks and codings: what `tinysplat eval` measures"),
}
"""By name: where it stands in this package, and a line about it."""

ORDINARY = ("waits", "formats", "growth")
"""What is measured where no study is named."""


def find_study(name: str) -> Study:
    """A study of STUDIES."""
    module, _, attribute = STUDIES[name][0].partition(".")
    return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
