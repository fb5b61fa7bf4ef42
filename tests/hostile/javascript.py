"""Damaged files for tsplat.js, which has to refuse them or to decode what the runtime decodes."""

from functools import lru_cache
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.planes import MAX_CODE
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.modes.decoder import decode_file

from . import corpus
from .containers import damage_container, damage_whole

SLOW_MS = 2000.0
MOST_MB = 200.0
"""Node itself, its compiled code and what LIMITS lets a file take."""

TOLERANCE, TERM_TOLERANCE = 1e-4, 1e-6
"""Of an array's largest value, and of the largest term of SH coefficients: damaged numbers cancel in float32 as a
file's own never do."""


def reference(data: bytes, options: dict[str, Any], store: GraphStore, limits: Limits) -> ts.Gaussians | str:
    """What the runtime decodes, or why it refuses."""
    try:
        first, is_prefix = data[: options.get("maxBytes")], "maxBytes" in options
        read = read_container(first, limits, is_prefix=is_prefix, is_damaged=bool(options.get("recover")))
        return decode_file(read, store, threads=1).flat()
    except FormatError as error:
        return str(error)


def largest_term(data: bytes, limits: Limits) -> float:
    """Bound of what is added up to an SH coefficient of the file's layers."""
    body = read_container(data, limits, is_prefix=True).body
    terms = [0.0]
    for layer in getattr(body, "layers", ()):
        basis = 1.0 if getattr(layer, "basis", None) is None else float(np.abs(layer.basis.astype(float)).max())
        terms += [(abs(c.offset) + MAX_CODE * abs(c.scale)) * basis for c in getattr(layer, "channels", ())]
    return max(terms)


def fault(
    data: bytes, said: dict[str, Any], found: dict[str, NDArray], wanted: ts.Gaussians | str, limits: Limits
) -> str | None:
    """What is wrong with tsplat.js's answer; None if nothing is."""
    if said["ms"] > SLOW_MS:
        return f"took {said['ms']:.0f} ms"
    if said["mb"] > MOST_MB:
        return f"node has {said['mb']:.0f} MB"
    if "error" in said:
        return None if said["error"] == "TsplatError" and said["section"] else f"{said['error']}: {said['stack']}"
    if isinstance(wanted, str):
        return f"decoded, where the runtime says: {wanted}"
    for name in FIELDS:
        theirs, ours = getattr(wanted, name), found[name]
        if theirs.shape != ours.shape:
            return f"{name}: shape {ours.shape}, expected {theirs.shape}"
        if not np.isfinite(ours).all():
            return f"{name} is not finite"
        difference = float(np.abs(ours - theirs.astype(np.float64)).max())
        accepted = TOLERANCE * max(float(np.abs(theirs).max()), 1e-30)
        if difference > accepted and not (name == "sh" and difference <= TERM_TOLERANCE * largest_term(data, limits)):
            return f"{name} differs by {difference:.3g} of {float(np.abs(theirs).max()):.3g}"
    return None


@lru_cache(maxsize=1)
def _decoders() -> tuple[Decoder, GraphStore]:
    return Decoder().__enter__(), GraphStore(threads=1)  # node ends with its standard input


def attack_javascript(rng: Random, limits: Limits) -> None:
    """Raise AssertionError unless tsplat.js's answer is right, and FormatError where both refuse."""
    seeds = rng.choices((corpus.tsplat_seeds(), corpus.list_seeds(), corpus.photo_file_seeds()), (0.7, 0.2, 0.1))[0]
    data = rng.choices((damage_whole, damage_container), (0.7, 0.3))[0](rng.choice(seeds), rng)
    options: dict[str, Any] = {}
    if rng.random() < 0.2:
        options["maxBytes"] = rng.randrange(len(data) + 10)
    if rng.random() < 0.2:
        options["recover"] = True
    decode, store = _decoders()
    said, found = decode(data, limits={"maxPixels": limits.max_pixels, "maxMemory": limits.max_memory_bytes}, **options)
    is_network = said.get("section", "") == "PHOT[0]"  # nothing is given here that could run it
    wanted = "a network is needed" if is_network else reference(data, options, store, limits)
    what = fault(data, said, found, wanted, limits)
    assert what is None, f"{what} ({options})"
    if isinstance(wanted, str):
        raise FormatError(wanted)
