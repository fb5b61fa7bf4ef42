"""The codec's graphs against float64: VPT, the two halves of VABR, and synthesis, on the inputs that coding gives them.

Errors are relative to the largest magnitude of an output (one per attribute; the figure is the worst attribute's), so
that planes and Gaussians of any unit compare. The reference is written from the formulas and runs in numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.codec import synthesis
from tinysplat_runtime.codec.decoder import decode_gaussians
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.inference import Graph, GraphStore
from tinysplat_runtime.system.blas import single_thread

from ..reference import transforms as reference
from .timing import Figures, Stage, Variant

Tensors = dict[str, NDArray]

_GEOMETRY_INPUTS = ("geometry_codes", "geometry_mix", "K", "rotation", "rotation_quat", "centre")

GRAPHS = ("analysis_vpt", "analysis_moment", "analysis_project", "synthesis")


@dataclass(frozen=True)
class _RecordingGraph(Graph):
    """A graph that remembers the inputs of its first run."""

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


def recorded_inputs(gaussians: Gaussians) -> dict[str, Tensors]:
    """What coding and decoding with the default profile feed to the graphs, by graph, for the first layer."""
    store = _RecordingStore()
    data = encode_gaussians(gaussians, find_profile(DEFAULT_PROFILE), 0, store, threads=1)
    strip = synthesis.STRIP_PX
    synthesis.STRIP_PX = gaussians.count  # whole views
    try:
        decode_gaussians(data, store, threads=1)
    finally:
        synthesis.STRIP_PX = strip
    views = len(gaussians.cameras)
    return {
        name: _joined(graph.seen, views) if name == "synthesis" else graph.seen[0]
        for name, graph in store.recorded.items()
    }


def _joined(seen: Sequence[Tensors], views: int) -> Tensors:
    """Inputs of the synthesis of the whole first layer, from those of its halves, a view each."""
    merged = dict(seen[0])
    for codes, names in (("geometry_codes", _GEOMETRY_INPUTS), ("color_codes", ("color_codes",))):
        half = [run for run in seen if run[codes].shape[2:] != (1, 1)][:views]
        for name in names:
            merged[name] = np.concatenate([run[name] for run in half])
    return merged


def transform_stages(case: str, gaussians: Gaussians, threads: int) -> list[Stage]:
    """One stage per graph: onnxruntime, the torch twin in float32, and the float64 reference."""
    inputs = recorded_inputs(gaussians)
    stages = []
    for name in GRAPHS:
        if name not in inputs:  # SH degree 0 has no VABR
            continue
        truth = _references(gaussians)[name]
        errors = _against(truth(inputs[name]))
        variants = [
            *(
                Variant(f"onnxruntime, {_threads(n)}", _graph(name, inputs[name], n), errors, threads=n)
                for n in sorted({1, threads})
            ),
            Variant(f"torch, {_threads(threads)}", _twin(name, inputs[name], threads), errors, threads=threads),
            Variant("numpy float64 (reference), 1 thread", partial(_on_one_thread, truth, inputs[name]), errors),
        ]
        stages.append(Stage(name, case, variants))
    return stages


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


def _on_one_thread(reference: Callable[[Tensors], Tensors], inputs: Tensors) -> Tensors:
    with single_thread():
        return reference(inputs)


def _graph(name: str, inputs: Tensors, threads: int) -> Callable[[], Tensors]:
    graph = GraphStore(threads=threads).transform(name)
    return lambda: graph.run(inputs)


_TWINS: dict[str, tuple[str, tuple[str, ...]]] = {
    "analysis_vpt": ("ViewProjection", ("geometry", "rotation_moment")),
    "analysis_moment": ("CoefficientMoment", ("moment",)),
    "analysis_project": ("CoefficientProjection", ("color",)),
    "synthesis": ("Synthesis", ("means", "quats", "scales", "opacities", "sh")),
}
"""Class in `tinysplat.transforms` and names of what it returns, by graph."""


def _twin(name: str, inputs: Tensors, threads: int) -> Callable[[], Tensors]:
    import torch

    from .. import transforms as twins

    twin, outputs = _TWINS[name]
    module = getattr(twins, twin)()
    tensors = {key: torch.from_numpy(np.ascontiguousarray(value)) for key, value in inputs.items()}

    def run() -> Tensors:
        torch.set_num_threads(threads)
        with torch.inference_mode():
            result = module(**tensors)
        values = result if isinstance(result, tuple) else (result,)
        return {key: value.numpy() for key, value in zip(outputs, values, strict=True)}

    return run


def _against(truth: Tensors) -> Callable[[Tensors], Figures]:
    # Channels of a stacked output have units of their own, so each counts against its own largest magnitude.
    def errors(found: Tensors) -> Figures:
        absolute, relative, square = [], [], []
        for name, wanted in truth.items():
            axes = (0, 2, 3) if name == "geometry" else None
            difference = np.abs(found[name].reshape(wanted.shape) - wanted)
            size = np.abs(wanted).max(axis=axes)
            absolute.append(float(difference.max()))
            relative.append(float((difference.max(axis=axes) / size).max()))
            square.append(float((np.sqrt((difference**2).mean(axis=axes)) / size).max()))
        return {"max_abs_error": max(absolute), "max_relative_error": max(relative), "rms_relative_error": max(square)}

    return errors


def _threads(count: int) -> str:
    return f"{count} thread{'s' * (count > 1)}"
