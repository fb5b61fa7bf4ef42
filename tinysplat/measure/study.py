"""What a study is, and what a run gives it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.options import Options, option

from .rows import Row, RowFile
from .show.tables import Table

Plot = Callable[[Path, Sequence[Row]], bool]
"""Draws rows of a run into a PNG file; False where none is its."""


@dataclass(frozen=True)
class Study:
    """A question.

    Attributes:
        title: of its part of the report.
        measure: what answers it; rows of one or more names of `Row.study`.
        tables: by name, in the report's order; places in README and docs name them too.
        plots: by name.
    """

    title: str
    measure: Callable[[Run], Iterator[Row]]
    tables: Mapping[str, Table]
    plots: Mapping[str, Plot] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StudyOptions(Options, group="options of some studies"):
    """What the command line adds to a study; each takes what concerns it."""

    qp: tuple[float, ...] = option(kinds.numbers(), (), metavar="Q,Q", help="Q_g; default the study's")
    views: tuple[int, ...] = option(kinds.indices, (), metavar="N,N", help="numbers of photos; growth, walk")
    limit: int | None = option(kinds.count, metavar="N", help="measure only lists, up to this size; growth")
    size: tuple[int, int] | None = option(kinds.size, metavar="WxH", help="of photos; default 256x256, quick 128x128")
    drawn: tuple[int, int] | None = option(
        kinds.size, metavar="WxH", help="of pictures to judge; default --size; walk, gate"
    )
    """At which pictures of captures are drawn."""
    mode: str | None = option(kinds.text, metavar="MODE", help="of files, as of encode; gate")


@dataclass
class Run:
    """One run of `tinysplat bench`.

    Attributes:
        quick: the short form.
        runtime: with the run's number of threads.
        store: keeps rows as they come.
        paths: of a user's scene folders, folders of such, or Gaussian files; what is built in takes their place where
            there are none.
        model: the network.
        options: what else the command line says.
        left_out: lines for the report.
    """

    quick: bool
    runtime: Runtime
    store: RowFile
    paths: Sequence[Path] = ()
    model: str = DEFAULT_MODEL
    options: StudyOptions = field(default_factory=StudyOptions)
    left_out: list[str] = field(default_factory=list)

    @property
    def threads(self) -> int:
        """How many the run may use."""
        return self.runtime.threads

    @property
    def side(self) -> int:
        """Of coded views, and of the pictures that networks are judged at."""
        return 128 if self.quick else 256

    @property
    def size(self) -> tuple[int, int]:
        """Of a user's photos."""
        return self.options.size or (self.side, self.side)

    def of_scenes(self, measure: Callable[[str, Scene], Iterator[Row]]) -> Iterator[Row]:
        """Rows of every scene folder, by its name and photos; one that is at fault is left out."""
        for path in self.paths:
            for folder in sorted(file.parent for file in path.glob(f"*/{CAMERAS_FILE}")) or [path]:
                try:
                    yield from measure(folder.resolve().name, load_scene(folder))
                except TinySplatError as error:
                    self.left_out.append(f"left out {folder.name}: {error}")
