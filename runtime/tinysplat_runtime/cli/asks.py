"""What commands ask for: options of their own, beside the requests of `recipe` and those of reading (`files`)."""

from dataclasses import dataclass
from functools import cached_property

from ..system import kinds
from ..system.options import REQUIRED, Options, flag, option
from ..system.voice import Voice
from .files import Limited
from .outputs import is_standard

GAUSSIAN_FILES = ".npz, .ply, … (docs/FORMATS.md)"

NOTHING = "where nothing is: white, black or #rrggbb"


@dataclass(frozen=True, kw_only=True)
class Quiet(Options):
    """Of every command."""

    quiet: bool = flag(short="q", help="no progress and no summary")

    @cached_property
    def voice(self) -> Voice:
        """Who says what a command has to say, and results on standard output."""
        return Voice(self.quiet, shows_results=True)


@dataclass(frozen=True, kw_only=True)
class Forced(Options):
    """Of those that write files."""

    force: bool = flag(help="overwrite outputs that exist")


@dataclass(frozen=True, kw_only=True)
class Output(Options):
    """Of those that write one file above all."""

    output: str = option(kinds.written, REQUIRED, short="o", metavar="F.tsplat", help="- for standard output")


@dataclass(frozen=True, kw_only=True)
class Written(Quiet, Forced, Output):
    """All three."""

    @cached_property
    def voice(self) -> Voice:
        """Says results on standard output, unless that is the file itself."""
        return Voice(self.quiet, shows_results=not is_standard(self.output))


@dataclass(frozen=True, kw_only=True)
class Reported(Written):
    """Of those whose seconds are of interest."""

    report: str | None = option(kinds.written, metavar="R.json", help="bytes, seconds, memory … as JSON")


@dataclass(frozen=True, kw_only=True)
class Described(Quiet):
    """Of those that print what there is."""

    json: bool = flag(help="as JSON")


@dataclass(frozen=True, kw_only=True)
class Encode(Reported):
    """`tinysplat encode`."""

    scene: tuple[str, ...] = option(
        kinds.path,
        REQUIRED,
        is_bare=True,
        is_many=True,
        metavar="SCENE",
        help="photos with cameras; two stereo photos; video",
    )
    output: str = option(
        kinds.written, REQUIRED, short="o", metavar="F.tsplat", help=".spz, .ply …: one list for any viewer"
    )


@dataclass(frozen=True, kw_only=True)
class Compress(Reported):
    """`tinysplat compress`."""

    file: str = option(
        kinds.path, REQUIRED, is_bare=True, metavar="G", help=f".tsplat, {GAUSSIAN_FILES}; - for standard input"
    )
    grid: tuple[int, int, int] | None = option(
        kinds.grid, metavar="V,H,W", help="the list is of pixels of V views of HxW"
    )


@dataclass(frozen=True, kw_only=True)
class Decode(Reported):
    """`tinysplat decode`."""

    file: str = option(kinds.path, REQUIRED, is_bare=True, metavar="F.tsplat", help="- for standard input")
    output: str = option(kinds.written, REQUIRED, short="o", metavar="G", help=GAUSSIAN_FILES)


@dataclass(frozen=True, kw_only=True)
class Convert(Written):
    """`tinysplat convert`."""

    files: tuple[str, ...] = option(kinds.path, REQUIRED, is_bare=True, is_many=True, metavar="IN", help="")
    """The line of usage tells what they are."""
    output: str = option(kinds.written, REQUIRED, short="o", metavar="OUT", help=f"as IN: .tsplat, {GAUSSIAN_FILES}")
    check: bool = flag(help="print bytes and loss in dB of the file")


@dataclass(frozen=True, kw_only=True)
class Drawn(Options, group="more"):
    """How Gaussians become pictures."""

    depth_scale: float = option(kinds.positive, 1000.0, metavar="S", help="values per scene unit; default 1000")
    dilation: str = option(
        kinds.text, "own", choices=("own", "screen"), help="widen by the photo's or the screen's pixel; default own"
    )
    order: str = option(
        kinds.text, "near", choices=("near", "depth"), help="draw near views first, or all by depth; default near"
    )


@dataclass(frozen=True, kw_only=True)
class Render(Reported, Drawn):
    """`tinysplat render`."""

    file: str = option(kinds.path, REQUIRED, is_bare=True, metavar="F", help=f".tsplat, {GAUSSIAN_FILES}")
    output: str = option(kinds.written, REQUIRED, short="o", metavar="OUT", help=".png or .mp4")
    camera: str | None = option(
        kinds.path, metavar="INDEX", help="a view or photo of the file, or cameras.json:INDEX; default 0"
    )
    path: str | None = option(kinds.text, choices=("between", "orbit"), only=".mp4", help="of a video; default between")
    story: str | None = option(
        kinds.path, metavar="FILE", only=".mp4", against=("path",), help="a video along the views of a page's story"
    )
    frames: int | None = option(
        kinds.count, metavar="N", help="of a video; default 60, of a capture 8 a view, of a story 30 a second"
    )
    size: tuple[int, int] | None = option(kinds.size, metavar="WxH", help="of pictures; default: the camera's")
    background: tuple[float, float, float] = option(
        kinds.colour, (0.0, 0.0, 0.0), metavar="COLOUR", help=f"{NOTHING}; default black"
    )
    panorama: bool = flag(only=".png", against=("depth", "depth_values"), help="a 360° picture from the camera's place")
    depth: bool = flag(only=".png", help="depth as a picture, near in red, far in blue")
    depth_values: bool = flag(only=".png", help="depth as numbers (z, 16-bit PNG)")


@dataclass(frozen=True, kw_only=True)
class Info(Described, Limited):
    """`tinysplat info`."""

    file: str = option(kinds.path, REQUIRED, is_bare=True, metavar="F", help=f".tsplat, {GAUSSIAN_FILES}")


@dataclass(frozen=True, kw_only=True)
class View(Quiet, Forced):
    """`tinysplat view`."""

    file: str | None = option(kinds.path, is_bare=True, metavar="F", help=f".tsplat, {GAUSSIAN_FILES}")
    html: str | None = option(kinds.written, metavar="OUT.html", help="write the page in place of serving it")
    files: bool = flag(
        needs=("html",), help="--html names a folder, whose files work on sites that allow no inline scripts"
    )
    player: bool = flag(
        needs=("html",),
        help="--html writes a page without a scene, which opens files dropped on it, chosen, or named by ?file=URL",
    )
    photos: str | None = option(
        kinds.path, metavar="SCENE", help="scene whose photos the page can show beside the render"
    )
    story: str | None = option(kinds.path, usual="", metavar="S.json", help="named views and notes; alone: to be made")
    cameras: str | None = option(kinds.path, metavar="cameras.json", help="views of a file that has none")
    background: tuple[float, float, float] | None = option(
        kinds.colour, metavar="COLOUR", help=f"{NOTHING}; default: of the scene's own colours"
    )
    port: int = option(kinds.port, 0, metavar="N", help="where to serve; default: any free port")
    no_browser: bool = flag(help="only print the address")


@dataclass(frozen=True, kw_only=True)
class Models(Described):
    """`tinysplat models`."""


@dataclass(frozen=True, kw_only=True)
class Doctor(Described):
    """`tinysplat doctor`."""

    warm: bool = flag(help="compile what is else compiled on first use")
    provider: str | None = option(
        kinds.text,
        metavar="NAME[:K=V,…]",
        help="run a made-up scene with it, and count the nodes of each graph that it ran",
    )
