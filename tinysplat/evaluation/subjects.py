"""What rate–distortion is measured on: windows brought to Gaussians, with the photos that some modes carry.

Which windows there are comes from `sources`; they are chosen by number of views, so that each number has its share.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.scene.scenes import Scene

from .records import code_fingerprint, model_fingerprint
from .runner import Job, Plan, list_jobs
from .sources import Case, FolderSource, LeftOut, Source

FILES = "file"
"""The network's name where a Gaussian file says nothing of the one that made it."""

_STAMP_LENGTH = 12


@dataclass(frozen=True, eq=False)
class Subject:
    """A window at hand.

    Attributes:
        model: the network, or a Gaussian file's name.
        case: Gaussians, target cameras, and photos where there are some.
        scene: the photos that the network was given; None for a Gaussian file.
    """

    model: str
    case: Case
    scene: Scene | None


def list_subjects(
    sources: Sequence[Source],
    models: Sequence[str],
    kinds: Sequence[str],
    views: Sequence[int],
    limit: int | None,
    size: tuple[int, int],
) -> tuple[list[Job], list[LeftOut]]:
    """Windows of every number of views, at most `limit` of each scene and number; and what is at fault."""
    jobs: list[Job] = []
    left_out: list[LeftOut] = []
    for count in views:
        found, lost, _ = list_jobs(Plan(sources, models, (), size, kinds, (count,), limit))
        jobs += found
        left_out += [entry for entry in lost if entry not in left_out]
    return jobs, left_out


def load_subject(job: Job, runtime: Runtime) -> Subject:
    """Run the network, or read the file; TinySplatError names what is at fault."""
    scene = None
    if isinstance(job.source, FolderSource):
        scene = job.source.scene().resized(*job.size).views(job.window.context)
    return Subject(job.model, job.source.load(job.window, job.model, job.size, runtime), scene)


def network_of(job: Job) -> str:
    """The network's name, FILES for a Gaussian file."""
    return job.model if job.source.needs_network else FILES


def stamp(job: Job) -> str:
    """Changes when anything that a window's figures depend on does: photos, network, code, libraries."""
    model = model_fingerprint(job.model) if job.source.needs_network else ""
    parts = (job.source.fingerprint(job.window), model, str(job.size), code_fingerprint())
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:_STAMP_LENGTH]
