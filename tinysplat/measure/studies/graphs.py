"""What do the graphs cost, and how exact are they? The whole chain by the size that networks work at, and the codec's
transforms against float64.

Whatever size a network works at, its Gaussians are rendered at one size and held against the photos of that size.
Errors of transforms are relative to the largest magnitude of an output (one per attribute; the figure is the worst
attribute's), so that planes and Gaussians of any unit compare.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tinysplat.reference import transforms as reference
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.decoder import decode_gaussians
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.inference import Graph, GraphStore
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.system.blas import single_thread

from ..clock import Figures, Variant, measure, plural
from ..pictures import photo_psnr
from ..rows import Row
from ..show.tables import (
    BYTES,
    TO_PHOTO,
    Cell,
    Column,
    Listing,
    View,
    duration,
    mean,
    said,
    small,
)
from ..study import Run, Study
from ..subjects.cases import Photos, Shots
from ..subjects.made import made_gaussians

Tensors = dict[str, NDArray]
CHAIN_SIDES, QUICK_CHAIN_SIDES = (128, 256), (128,)
CODINGS = (("fast", 0.0), ("balanced", 0.0), ("balanced", 6.0), ("max", 0.0), ("paper", 0.0))
QUICK_CODINGS = (("fast", 0.0), ("balanced", 0.0))

# ---- chain and networks -------------------------------------------------------------------------------------------


def _judged(shots: Shots) -> Photos:
    """Photos that Gaussians are held against: targets, or the inputs without any."""
    return shots.targets if shots.targets.cameras else shots.context


def chain_rows(run: Run) -> Iterator[Row]:
    """Photos to a picture in one call, by network, size and coding."""
    sides, codings = (QUICK_CHAIN_SIDES, QUICK_CODINGS) if run.quick else (CHAIN_SIDES, CODINGS)
    for source, window in run.photos:
        judged = _judged(source.shots(window, (run.side, run.side)))
        variants = []
        for model in run.models:
            for side in sides:
                shots = source.shots(window, (side, side))
                for profile, qp in codings:
                    label = f"{model} at {side}×{side}, {profile} qp {qp:g}"
                    setting = {"model": model, "side": side, "profile": profile, "qp": qp}
                    chain = partial(_chain, shots, model, profile, qp, judged, run.runtime)
                    figures = partial(_file_figures, judged=judged, run=run)
                    variants.append(Variant(label, chain, figures, setting, run.threads))
        yield from measure("chain", source.name, variants, run.effort)


def _chain(shots: Shots, model: str, profile: str, qp: float, judged: Photos, runtime: Runtime) -> bytes:
    """Photos to a picture; returns the file on the way."""
    graph, context = runtime.store.network(model), shots.context
    gaussians = predict(context.images, context.cameras, shots.near, shots.far, graph)
    data = runtime.compress(gaussians, profile, qp, drop_invalid=True)
    runtime.render(runtime.decompress(data), judged.cameras[0])
    return data


def _file_figures(data: bytes, judged: Photos, run: Run) -> Figures:
    psnr = photo_psnr(run.runtime.decompress(data), judged.cameras, judged.images, run.drawing)
    return {"bytes": len(data), "psnr": psnr}


def depths(gaussians: Gaussians) -> NDArray:
    """(V, H, W) float32 z of layer 0 in the own camera's frame."""
    pairs = zip(gaussians.means, gaussians.cameras, strict=True)
    return np.stack([(m + (gaussians.origin - c.centre)) @ c.rotation[2] for m, c in pairs]).astype(np.float32)


CHAIN = Study.of(
    "The whole chain",
    chain_rows,
    View(
        "chain",
        "The whole chain",
        "Photos to Gaussians to a file to Gaussians to one picture, in one call. dB against photos that the network did"
        " not see where there are any, else against its input photos; all judged at one size.",
        (BYTES, TO_PHOTO),
        costs=("bytes",), gains=("psnr",), y="psnr", y_label="dB to photo", group="profile",
    ),
)  # fmt: skip

# ---- transforms ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _RecordingGraph(Graph):
    """A graph that remembers the inputs of its runs."""

    seen: list[Tensors] = field(default_factory=list)

    def run(self, inputs: Mapping[str, NDArray], outputs: Sequence[str] | None = None) -> Tensors:
        """See `Graph.run`."""
        self.seen.append(dict(inputs))
        return super().run(inputs, outputs)

    def run_into(self, inputs: Mapping[str, NDArray], outputs: Mapping[str, NDArray]) -> None:
        """See `Graph.run_into`."""
        self.seen.append(dict(inputs))
        super().run_into(inputs, outputs)


class _RecordingStore(GraphStore):
    """Opens graphs that record."""

    def __init__(self) -> None:
        super().__init__(threads=1)
        self.recorded: dict[str, _RecordingGraph] = {}

    def transform(self, name: str) -> Graph:
        """See `GraphStore.transform`."""
        if name not in self.recorded:
            graph = super().transform(name)
            self.recorded[name] = _RecordingGraph(graph.name, graph.session, graph.metadata, graph.output_names)
        return self.recorded[name]


_GEOMETRY_INPUTS = ("geometry_codes", "geometry_mix", "K", "rotation", "rotation_quat", "centre")

GRAPHS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "analysis_vpt": ("VPT", "ViewProjection", ("geometry", "rotation_moment")),
    "analysis_moment": ("VABR, second moment", "CoefficientMoment", ("moment",)),
    "analysis_project": ("VABR, projection", "CoefficientProjection", ("color",)),
    "synthesis": ("dequantisation, VABR⁻¹, VPT⁻¹", "Synthesis", ("means", "quats", "scales", "opacities", "sh")),
}
"""What it does, its class in `tinysplat.transforms`, and names of what it returns, by graph."""


def recorded_inputs(gaussians: Gaussians) -> dict[str, Tensors]:
    """What coding and decoding with the default profile feed to the graphs, by graph, for the first layer.

    Views are at most 256×256 here: what coding and decoding look at at a time.
    """
    store = _RecordingStore()
    decode_gaussians(encode_gaussians(gaussians, find_profile(DEFAULT_PROFILE), 0, store, threads=1), store, threads=1)
    views = len(gaussians.cameras)
    seen = {name: graph.seen for name, graph in store.recorded.items()}
    return {
        "analysis_vpt": _stacked(seen["analysis_vpt"][:views]),
        "analysis_moment": seen["analysis_moment"][0],
        "analysis_project": {**seen["analysis_project"][0], **_stacked(seen["analysis_project"][:views], ("sh",))},
        "synthesis": _joined(seen["synthesis"], views),
    }


def _stacked(seen: Sequence[Tensors], names: Sequence[str] | None = None) -> Tensors:
    """Inputs of those names, or all, of a whole layer, from those of its views."""
    return {name: np.concatenate([run[name] for run in seen]) for name in names or seen[0]}


def _joined(seen: Sequence[Tensors], views: int) -> Tensors:
    """Inputs of the synthesis of the whole first layer, from those of its halves, a view each."""
    merged = dict(seen[0])
    for codes, names in (("geometry_codes", _GEOMETRY_INPUTS), ("color_codes", ("color_codes",))):
        half = [run for run in seen if run[codes].shape[2:] != (1, 1)][:views]
        merged |= _stacked(half, names)
    return merged


def transform_rows(run: Run) -> Iterator[Row]:
    """A subject per graph: onnxruntime, the torch twin in float32, and the float64 reference."""
    side = run.side
    gaussians = made_gaussians(2, side, side, 4)
    inputs = recorded_inputs(gaussians)
    for name in GRAPHS:
        truth = _references(gaussians)[name]
        errors = partial(_relative_errors, truth(inputs[name]))
        variants = [
            *(Variant(f"onnxruntime, {plural(n)}", partial(GraphStore(threads=n).transform(name).run, inputs[name]),
                      errors, threads=n) for n in run.thread_counts),
            Variant(f"torch, {plural(run.threads)}", _twin(name, inputs[name], run.threads), errors,
                    threads=run.threads),
            Variant("numpy float64 (reference), 1 thread", partial(_on_one_thread, truth, inputs[name]), errors),
        ]  # fmt: skip
        yield from measure("transforms", f"{GRAPHS[name][0]}, 2×{side}×{side}, SH degree 4", variants, run.effort)


def _references(gaussians: Gaussians) -> dict[str, Callable[[Tensors], Tensors]]:
    def vpt(_: Tensors) -> Tensors:
        planes = np.stack([reference.project_view(gaussians, v) for v in range(len(gaussians.cameras))])
        q = planes[:, 6:10].reshape(len(planes), 4, -1)
        return {"geometry": planes, "rotation_moment": q @ q.swapaxes(1, 2) / q.shape[2]}

    return {
        "analysis_vpt": vpt,
        "analysis_moment": lambda t: {"moment": reference.coefficient_moment(t["sh"])},
        "analysis_project": lambda t: {"color": reference.project_coefficients(t["sh"], t["projection"])},
        "synthesis": lambda t: reference.synthesise(t, gaussians.cameras, gaussians.origin),
    }


def _on_one_thread(truth: Callable[[Tensors], Tensors], inputs: Tensors) -> Tensors:
    with single_thread():
        return truth(inputs)


def _twin(name: str, inputs: Tensors, threads: int) -> Callable[[], Tensors]:
    import torch

    from tinysplat import transforms as twins

    _, twin, outputs = GRAPHS[name]
    module = getattr(twins, twin)()
    tensors = {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in inputs.items()}

    def run() -> Tensors:
        torch.set_num_threads(threads)
        with torch.inference_mode():
            result = module(**tensors)
        values = result if isinstance(result, tuple) else (result,)
        return {key: value.numpy() for key, value in zip(outputs, values, strict=True)}

    return run


def _relative_errors(truth: Tensors, found: Tensors) -> Figures:
    """Channels of a stacked output have units of their own, so each counts against its own largest magnitude."""
    absolute, relative, square = [], [], []
    for name, wanted in truth.items():
        axes = (0, 2, 3) if name == "geometry" else None
        difference = np.abs(found[name].reshape(wanted.shape) - wanted)
        size = np.abs(wanted).max(axis=axes)
        absolute.append(float(difference.max()))
        relative.append(float((difference.max(axis=axes) / size).max()))
        square.append(float((np.sqrt((difference**2).mean(axis=axes)) / size).max()))
    return {"max_abs_error": max(absolute), "max_relative_error": max(relative), "rms_relative_error": max(square)}


def _of_way(beginning: str, cell: Cell) -> Cell:
    """What a cell says of the first row whose way begins so."""
    return lambda rows: cell([row for row in rows if row.way.startswith(beginning)][:1])


_ERROR = "max_relative_error"
_TRANSFORMS = View(
    "transforms",
    "Transforms",
    "The codec's graphs. Errors against float64, relative to an output's largest magnitude.",
    (
        Column(_ERROR, "largest, relative", small),
        Column("rms_relative_error", "RMS, relative", small),
        Column("max_abs_error", "largest, absolute", small),
    ),
    costs=(_ERROR,),
)
_IN_SHORT = Listing(
    "transforms",
    {
        "graph": said("subject"),
        "onnxruntime": _of_way("onnxruntime", mean("seconds", duration, "costs")),
        "error": _of_way("onnxruntime", mean(_ERROR, small)),
        "torch": _of_way("torch", mean("seconds", duration, "costs")),
        "its error": _of_way("torch", mean(_ERROR, small)),
        "float64": _of_way("numpy", mean("seconds", duration, "costs")),
    },
    by=("subject",),
)
TRANSFORMS = Study("Transforms", transform_rows, {"transforms": _TRANSFORMS, "transforms in short": _IN_SHORT})
