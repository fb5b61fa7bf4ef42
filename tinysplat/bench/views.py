"""How each stage is shown: what its text says, which columns its table has, and what counts as an error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .timing import Row

Format = Callable[[float], str]


def kilobytes(value: float) -> str:
    """Bytes in KB of 1000."""
    return f"{value / 1000:,.1f}" if value < 1e6 else f"{value / 1000:,.0f}"


def decibels(value: float) -> str:
    """dB, two digits."""
    return "∞" if math.isinf(value) else f"{value:.2f}"


def small(value: float) -> str:
    """An error, two significant digits."""
    return f"{value:.1e}" if value else "0"


def percent(value: float) -> str:
    """A share."""
    return f"{100 * value:.2f} %"


def whole(value: float) -> str:
    """A count."""
    return f"{value:,.0f}"


def seconds(value: float) -> str:
    """Seconds in the unit that suits them."""
    if value >= 1:
        return f"{value:.2f} s"
    return f"{1000 * value:.1f} ms" if value >= 1e-3 else f"{1e6 * value:.0f} µs"


def megabytes(value: float) -> str:
    """Bytes in MB of 10⁶."""
    return f"{value / 1e6:.0f} MB"


@dataclass(frozen=True)
class Column:
    """A figure in a table: its key in `Row.figures`, its heading, and how it is written."""

    key: str
    heading: str
    write: Format


@dataclass(frozen=True)
class View:
    """A stage's place in the report.

    Attributes:
        title: of the section.
        text: what is measured and what the columns mean.
        columns: of the table, behind the seconds.
        costs: figures that are better when lower, beside the seconds; they decide the Pareto front.
        gains: figures that are better when higher.
        y: figure on the plot's vertical axis, or None for no plot.
        y_label: its name.
        is_log: whether that axis is logarithmic.
        group: setting whose values are joined by a line, or None.
    """

    title: str
    text: str
    columns: Sequence[Column]
    costs: Sequence[str] = ()
    gains: Sequence[str] = ()
    y: str | None = None
    y_label: str = ""
    is_log: bool = False
    group: str | None = None


_DECODED = Column("psnr_decoded_raw", "dB to raw", decibels)
_LOST = Column("db_lost", "dB lost to photo", decibels)
_BYTES = Column("bytes", "KB", kilobytes)
_FLOAT64 = (
    Column("median_error", "median error", small),
    Column("error_999", "99.9 %", small),
    Column("max_error", "largest", small),
    Column("share_above_1e-4", "above 1e-4", percent),
)
_GRAPH = View(
    "",
    "Errors against float64 relative to an output's largest magnitude.",
    (
        Column("max_relative_error", "largest, relative", small),
        Column("rms_relative_error", "RMS, relative", small),
        Column("max_abs_error", "largest, absolute", small),
    ),
    costs=("max_relative_error",),
)


def _graph(title: str, text: str) -> View:
    return View(title, f"{text} {_GRAPH.text}", _GRAPH.columns, _GRAPH.costs)


VIEWS: dict[str, View] = {
    "chain": View(
        "The whole chain",
        "Photos to Gaussians to a file to Gaussians to one picture, in one call. dB against photos that the network did"
        " not see where there are any, else against its input photos; all judged at one size.",
        (_BYTES, Column("psnr", "dB to photo", decibels)),
        costs=("bytes",),
        gains=("psnr",),
        y="psnr",
        y_label="dB to photo",
        group="profile",
    ),
    "network": View(
        "Networks",
        "Photos to Gaussians. Whatever size a network works at, its Gaussians are judged by pictures of one size."
        " Depth: mean |z − true z| / true z. The last columns hold depth against the torch twin in float64, where there"
        " is one; a rounding that decides between two candidates shows in the 99 % quantile.",
        (
            Column("psnr", "dB at targets", decibels),
            Column("psnr_inputs", "dB at inputs", decibels),
            Column("depth_abs_rel", "depth error", percent),
            Column("depth_error_median", "float64: median", small),
            Column("depth_error_99", "float64: 99 %", small),
        ),
        costs=("depth_abs_rel",),
        gains=("psnr", "psnr_inputs"),
        y="psnr_inputs",
        y_label="dB at input views",
        group="model",
    ),
    "analysis_vpt": _graph("VPT", "Gaussians to planes."),
    "analysis_moment": _graph("VABR: second moment", "The d×d moment of the SH coefficients."),
    "analysis_project": _graph("VABR: projection", "SH coefficients to colour planes."),
    "synthesis": _graph("Synthesis", "Codes to Gaussians: dequantisation, VABR⁻¹, VPT⁻¹."),
    "encode": View(
        "Encoding",
        "Gaussians to a file, by profile and Q_g. `× x265` is the time over that of libx265 alone on the same planes,"
        " with the same threads, in the same round (CPU seconds in brackets). dB to raw: pictures of the decoded"
        " Gaussians against those of the raw ones, over the input views and views in between.",
        (_BYTES, _DECODED, _LOST, Column("k", "k", whole), Column("rmse_means", "RMSE of means", small)),
        costs=("bytes",),
        gains=("psnr_decoded_raw",),
        y="psnr_decoded_raw",
        y_label="dB to raw",
        group="profile",
    ),
    "preset": View(
        "Presets of libx265",
        "The default profile's planes by other presets.",
        (_BYTES, _DECODED),
        costs=("bytes",),
        gains=("psnr_decoded_raw",),
        y="bytes",
        y_label="bytes",
    ),
    "decode": View(
        "Decoding",
        "A file's bytes to Gaussians. `× avcodec` is the time over that of libavcodec alone on the same streams, with"
        " the same threads, in the same round (CPU seconds in brackets).",
        (_BYTES, Column("planes", "planes", whole)),
    ),
    "cold start": View(
        "Cold start",
        "`tinysplat decode F.tsplat -o G.npz` as a process: interpreter, imports, graphs, decoding, writing.",
        (_BYTES, Column("planes", "planes", whole)),
    ),
    "rasteriser": View(
        "Rasteriser",
        "A frame of a prepared renderer, SH degree 3; errors of pixel values in [0, 1] against float64 at a random 1 %"
        " of the pixels. Where rounding decides a threshold (1/255) or the order of two depths, a pixel may be off by"
        " more.",
        _FLOAT64,
        costs=("median_error",),
    ),
    "rasteriser approximations": View(
        "Rasteriser: less work",
        "What can be had for less: a picture of half the size scaled up, and fewer SH bands; dB against the exact"
        " picture.",
        (Column("psnr_exact", "dB to exact", decibels), Column("max_error", "largest error", small)),
        gains=("psnr_exact",),
        y="max_error",
        y_label="largest error of a pixel",
        is_log=True,
    ),
    "torch rasteriser": View(
        "Rasteriser: peer",
        "gsplat's torch functions for projection and SH, its alphas blended densely in torch: another implementation of"
        " the same definition, for correctness first. Errors as above.",
        _FLOAT64,
    ),
    "k": View(
        "Colour planes (k)",
        "Profile `paper` with k planes; the last column is what k planes give when nothing is quantised.",
        (_BYTES, _DECODED, _LOST, Column("psnr_vabr_alone", "dB, VABR alone", decibels)),
        costs=("bytes",),
        gains=("psnr_decoded_raw",),
        y="psnr_decoded_raw",
        y_label="dB to raw",
    ),
    "SH degree": View(
        "SH degree",
        "The default profile on the same Gaussians with the bands above a degree cut off; pictures against those of all"
        " bands. The last column is the loss of the cut alone.",
        (_BYTES, _DECODED, Column("k", "k", whole), Column("psnr_bands_alone", "dB, cut alone", decibels)),
        costs=("bytes",),
        gains=("psnr_decoded_raw",),
        y="psnr_decoded_raw",
        y_label="dB to raw",
    ),
}
"""By stage, in the report's order. Peers and growth have tables of their own."""


@dataclass(frozen=True)
class Front:
    """Which rows of a stage no other row beats in everything.

    Attributes:
        members: their variants.
        is_meaningful: whether anything but seconds counts, and there was a choice.
    """

    members: frozenset[str]
    is_meaningful: bool

    @classmethod
    def of(cls, view: View, rows: Sequence[Row]) -> Front:
        """Rows of one stage and case; those that lack a figure that counts are left aside."""
        keys = [*view.costs, *view.gains]
        vectors = {}
        for row in rows:
            present = [key for key in keys if any(key in other.figures for other in rows)]
            if row.seconds is not None and all(key in row.figures for key in present):
                signed = [-row.figures[k] if k in view.gains else row.figures[k] for k in present]
                vectors[row.variant] = (row.seconds.median, *signed)
        beaten = {
            name
            for name, vector in vectors.items()
            for other in vectors.values()
            if other != vector and all(o <= v for o, v in zip(other, vector, strict=True))
        }
        return cls(frozenset(set(vectors) - beaten), bool(keys) and len(rows) > 1)
