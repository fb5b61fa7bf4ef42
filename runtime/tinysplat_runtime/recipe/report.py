"""What is said of a file that was made or read: bytes, seconds, memory and errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..container.inspection import inspect_bytes
from ..gaussian.difference import attribute_errors
from ..modes.decoder import decode_gaussians
from ..system.jsonfields import JsonObject
from ..system.stopwatch import Stopwatch, peak_rss_bytes

if TYPE_CHECKING:  # who decodes loads no encoder
    from .compress import Encoded
    from .steps import Tools


def file_report(described: JsonObject, watch: Stopwatch) -> JsonObject:
    """A .tsplat file as `inspect_bytes` describes it, with the seconds of each stage and this process's peak memory."""
    keys = (
        "mode", "bytes", "bytes_by_class", "metadata_bytes", "views", "height", "width", "gaussians", "sh_degree", "k",
    )  # fmt: skip
    return {
        **{key: described[key] for key in keys},
        "error_by_attribute": {},
        "clipped": {},
        "seconds": watch.seconds,
        "peak_rss_bytes": peak_rss_bytes(),
        "left_out": described["left_out"],
        "pruned": described["pruned"],
    }


def encode_report(coded: Encoded, tools: Tools, *, model: str | None) -> JsonObject:
    """The report of `encode` and `compress`: the file's, and the error of each attribute.

    Args:
        coded: what came of coding, its Gaussians kept.
        tools: that coded.
        model: the network, for files of photos.
    """
    assert coded.gaussians is not None
    # Gaussians of no pixels come back in another order, and not all of them.
    errors = {}
    if coded.gaussians.is_per_pixel:
        decoded = decode_gaussians(coded.data, tools.store, threads=tools.threads, limits=tools.limits, model=model)
        errors = attribute_errors(coded.gaussians, decoded)
    return {
        **file_report(inspect_bytes(coded.data), coded.stats.watch),
        "clipped": coded.stats.clipped,
        "error_by_attribute": errors,
        **({"psnr": coded.stats.psnr, "seen_from": coded.stats.views} if coded.stats.views else {}),
    }
