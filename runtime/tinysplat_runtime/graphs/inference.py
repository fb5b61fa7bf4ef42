"""Open an ONNX artifact with onnxruntime, hold it to its role's contract, and run it.

The contract fixes names, element types and ranks; sizes are dynamic. It is checked when a graph is opened, so that a
wrong file is refused with what is wrong before any work is done.
"""

import json
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..system.threads import available_cores
from .artifacts import Artifact, find_artifact, load_manifest, network_by_hash
from .providers import CPU, Provider, add_providers, first_line, nodes_by_provider

CONTRACT_VERSION = 1

_NO_MEMORY = "bad_alloc"  # as onnxruntime has it
_F32, _U16 = "tensor(float)", "tensor(uint16)"


@dataclass(frozen=True)
class Contract:
    """Tensors of a graph: name to (element type, rank)."""

    inputs: Mapping[str, tuple[str, int]]
    outputs: Mapping[str, tuple[str, int]]


def _f32(**ranks: int) -> dict[str, tuple[str, int]]:
    """Tensors of float32 by name, of those ranks."""
    return {name: (_F32, rank) for name, rank in ranks.items()}


_CAMERA = _f32(K=3, rotation=3, rotation_quat=2)
_GEOMETRY = _f32(means=4, quats=4, scales=4, opacities=3)
_GAUSSIANS_OUT = {**_GEOMETRY, **_f32(sh=5)}


def _stage(inputs: str, outputs: Mapping[str, tuple[str, int]] | str, **others: int) -> Contract:
    """Of a stage: its cameras and maps, whose names are given, and others in; maps or something else out."""
    maps = outputs if isinstance(outputs, Mapping) else dict.fromkeys(outputs.split(), (_F32, 4))
    given = {**_f32(K=3, c2w=3, ranges=2), **dict.fromkeys(inputs.split(), (_F32, 4)), **_f32(**others)}
    return Contract(given, maps)


CONTRACTS: dict[str, Contract] = {
    "network": Contract(_f32(images=4, K=3, c2w=3, near=1, far=1), _GAUSSIANS_OUT),
    "analysis_vpt": Contract(
        {**_GEOMETRY, **_CAMERA, **_f32(centre_high=2, centre_low=2)}, _f32(geometry=4, rotation_moment=3)
    ),
    "analysis_moment": Contract(_f32(sh=5), _f32(moment=2)),
    "analysis_project": Contract(_f32(sh=5, projection=2), _f32(color=4)),
    "synthesis": Contract(
        {
            "geometry_codes": (_U16, 4),
            **_f32(geometry_mix=3),
            "color_codes": (_U16, 4),
            **_f32(color_mix=2),
            **_CAMERA,
            **_f32(centre=2, inverse_depth=0, relative_rotation=0, depth_limits=1),
        },
        {**_GEOMETRY, **_f32(sh=4)},
    ),
    "enlarge": Contract(
        {
            **_f32(photo=4, small=4, rows=1, columns=1),
            **_f32(K=3, c2w=3, sources=4, source_K=3, rotation=3, translation=2, unit=0),
        },
        _GAUSSIANS_OUT,
    ),
    "stage_glance": _stage("cells", "level"),
    "stage_settle": _stage("cells levels", _f32(there=4, sound=4, range=2)),
    "stage_match": _stage("half", "costs paths coarse_paths level"),
    "stage_estimate": _stage(
        "half costs paths coarse_paths levels", "level agreement features coarse_features full clues"
    ),
    "stage_dress": _stage(
        "images shown levels agreements features coarse_features full clues", "level opacity footprint colours changes"
    ),
    "stage_finish": _stage("shown levels alphas footprint colours changes", _GAUSSIANS_OUT, far=1),
}
"""By role `network`, by name for the graphs of the roles `analysis`, `synthesis` and `enlarge`, and by what comes after
a network's name for its stages."""

STAGES = tuple(name for name in CONTRACTS if name.startswith("stage_"))


@dataclass(frozen=True)
class Graph:
    """An opened artifact.

    Attributes:
        name: the artifact's name.
        session: onnxruntime.InferenceSession.
        metadata: the JSON object under the file's metadata key `tinysplat`; empty if there is none.
        output_names: all outputs in the file's order.
        lets_go: whether what a run takes is given back after it, and not kept for the next.
    """

    name: str
    session: Any
    metadata: Mapping[str, Any] = field(default_factory=dict)
    output_names: tuple[str, ...] = ()
    lets_go: bool = False

    def run(self, inputs: Mapping[str, NDArray], outputs: Sequence[str] | None = None) -> dict[str, NDArray]:
        """Run the graph.

        Args:
            inputs: every input by name, in the contract's shape and dtype.
            outputs: names wanted; all when None.

        Returns:
            Arrays by name.

        Raises:
            ModelError: onnxruntime refused the inputs or failed; says what it said, in one line.
        """
        names = list(outputs or self.output_names)
        try:
            options = []
            if self.lets_go:
                options.append(onnxruntime().RunOptions())
                options[0].add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
            values = self.session.run(names, dict(inputs), *options)
        except Exception as error:  # onnxruntime raises a dozen unrelated types
            raise self._failed(error) from error
        return dict(zip(names, values, strict=True))

    def run_into(self, inputs: Mapping[str, NDArray], outputs: Mapping[str, NDArray]) -> None:
        """Run the graph, some outputs straight into arrays.

        Args:
            inputs: every input by name, C-contiguous in the contract's dtype; those that the wanted outputs do not
                depend on may have any size.
            outputs: C-contiguous arrays of exactly the results' shapes by name, overwritten.

        Raises:
            ModelError: as `run`.
        """
        binding = self.session.io_binding()
        try:
            for name, array in inputs.items():
                binding.bind_cpu_input(name, array)
            for name, array in outputs.items():
                binding.bind_output(name, "cpu", 0, array.dtype, array.shape, array.ctypes.data)
            self.session.run_with_iobinding(binding)
        except Exception as error:
            raise self._failed(error) from error

    def _failed(self, error: Exception) -> Exception:
        said = first_line(error)
        return MemoryError(said) if _NO_MEMORY in said else ModelError(f"onnxruntime: {said}", where=self.name)


def open_graph(
    artifact: Artifact,
    contract: str,
    *,
    threads: int | None = None,
    providers: Sequence[Provider] = (CPU,),
    profile: str | None = None,
) -> Graph:
    """Verify, load and check an artifact.

    Args:
        artifact: what to open.
        contract: key of `CONTRACTS`.
        threads: threads inside an operator; None for all cores this process may use.
        providers: onnxruntime execution providers in order of preference.
        profile: beginning of a file's name to write to which provider ran what (`nodes_by_provider` reads it).

    Raises:
        ModelError: unreadable, altered, not ONNX, an operator onnxruntime lacks, another contract, or no such provider.
    """
    ort = onnxruntime()
    ort.set_default_logger_severity(4)  # failures come back as exceptions; nothing else belongs on standard error
    options = ort.SessionOptions()
    options.log_severity_level = 4
    options.intra_op_num_threads = threads or available_cores()
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads must not steal x265's cores
    # A stage runs once a photo, and in between others need what it took; its arena is twice as large as its tensors.
    options.enable_cpu_mem_arena = contract not in STAGES
    if profile is not None:
        options.enable_profiling, options.profile_file_prefix = True, profile
    chosen = add_providers(ort, options, providers)
    stored = artifact
    if all((provider if isinstance(provider, str) else provider[0]) == CPU for provider in providers):
        stored = artifact.for_cpu()
    try:
        graph, tensors = _opened(stored, contract, options, chosen)
    except ModelError:
        if stored is artifact:
            raise
        graph, tensors = _opened(artifact, contract, options, chosen)  # without operators of onnxruntime's own
    _check_contract(graph, tensors, CONTRACTS[contract], str(artifact.path))
    return graph


def _opened(
    artifact: Artifact, contract: str, options: Any, providers: Sequence[Any] | None
) -> tuple[Graph, dict[str, dict[str, tuple[str, int]]]]:
    """A graph as it is, and its tensors by kind and name; ModelError for what is none."""
    # A user's network may keep its weights beside the file, which only a path can find.
    source = artifact.read() if artifact.sha256 is not None else str(artifact.path)
    try:
        # Its fallback would print to standard output, and try again what just failed.
        session = onnxruntime().InferenceSession(source, options, providers=providers, enable_fallback=0)
        names = tuple(o.name for o in session.get_outputs())
        # A network takes hundreds of megabytes, and what comes after it needs them; other graphs run again at once.
        graph = Graph(artifact.name, session, _metadata(session), names, lets_go=contract == "network")
        return graph, {"input": _tensors(session.get_inputs()), "output": _tensors(session.get_outputs())}
    except Exception as error:  # UnicodeDecodeError among them: names in a file need not be UTF-8
        raise ModelError(f"not a graph onnxruntime can run: {first_line(error)}", where=str(artifact.path)) from error


def onnxruntime() -> ModuleType:
    """The library, loaded on first use so that commands without a graph start without it, and told to send nothing.

    From 1.31 on it counts what it does into a database in the home folder, for an address in its binary, unless this
    variable says not to when it is loaded; a value that the user has set stands.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime as library

    return library


class GraphStore:
    """Opens each graph once, on first use; safe to share among threads.

    Args:
        threads: threads inside an operator of the synthesis; None for all cores this process may use. Networks and
            analysis always use all of them: onnxruntime splits long sums by threads, so that another number would
            change last bits, and with them the bytes of a file.
        providers: onnxruntime execution providers in order of preference.
        models: folder of the artifacts; None for the usual places.
        profile: folder to note in which provider ran what; None not to.
    """

    def __init__(
        self,
        *,
        threads: int | None = None,
        providers: Sequence[Provider] = (CPU,),
        models: str | os.PathLike[str] | None = None,
        profile: str | None = None,
    ) -> None:
        self._threads, self._providers, self._models, self._profile = threads, tuple(providers), models, profile
        self._graphs: dict[str, Graph] = {}
        self._lock = threading.Lock()

    def transform(self, name: str) -> Graph:
        """A graph of the codec, by its name in `CONTRACTS`."""
        return self._open(name, name.split("_")[0], name)

    def enlarger(self) -> Graph | None:
        """The graph `enlarge`; None where the models' folder has none, and networks run on photos however large."""
        return self.transform("enlarge") if "enlarge" in load_manifest(self._models) else None

    def network(self, name: str) -> Graph:
        """A network, by its name in the manifest or the path of its file."""
        return self._open(name, "network", "network")

    def has_stages(self, name: str) -> bool:
        """Whether a network has stages, through which photos go one by one."""
        artifact = find_artifact(name, "network", self._models)
        files = _stage_files(artifact.name).values()
        return artifact.entry is not None and load_manifest(self._models).keys() >= set(files)

    def stages(self, name: str) -> dict[str, Graph]:
        """The stages of a network that has some, by their own names."""
        return {stage: self._open(file, "stage", f"stage_{stage}") for stage, file in _stage_files(name).items()}

    def network_ref(self, name: str) -> tuple[str, str]:
        """(name, sha256) of a network's ONNX file, by which `network_by_hash` finds it again."""
        artifact = find_artifact(name, "network", self._models)
        return artifact.name, artifact.file_sha256()

    def shipped_network(self, name: str) -> str | None:
        """The name of a network in the manifest; None for a user's own file."""
        artifact = find_artifact(name, "network", self._models)
        return artifact.name if artifact.sha256 is not None else None

    def network_by_hash(self, name: str, sha256: str, given: str | None = None) -> Graph:
        """The network of exactly that hash; arguments and errors of `artifacts.network_by_hash`."""
        artifact = network_by_hash(name, sha256, given, self._models)
        return self.network(artifact.name if artifact.sha256 else str(artifact.path))

    def _open(self, name: str, role: str, contract: str) -> Graph:
        with self._lock:
            if name not in self._graphs:
                artifact = find_artifact(name, role, self._models)
                threads = self._threads if role == "synthesis" else None
                profile = self._profile and str(Path(self._profile, contract))
                self._graphs[name] = open_graph(
                    artifact, contract, threads=threads, providers=self._providers, profile=profile
                )
            return self._graphs[name]

    def nodes_by_provider(self) -> dict[str, dict[str, int]]:
        """Of a store with `profile`: how often which provider ran a node, by graph; ends the noting."""
        return {name: nodes_by_provider(graph.session.end_profiling()) for name, graph in self._graphs.items()}


def _stage_files(network: str) -> dict[str, str]:
    """Names in the manifest of a network's stages, by their own."""
    names = [stage.removeprefix("stage_") for stage in STAGES]
    return {name: f"{network}_{name}" for name in names}


def as_input(array: NDArray | Sequence[Any] | float) -> NDArray:
    """A C-contiguous float32 array, any shape."""
    return np.asarray(array, dtype=np.float32, order="C")


def _metadata(session: Any) -> Mapping[str, Any]:
    text = session.get_modelmeta().custom_metadata_map.get("tinysplat", "{}")
    try:
        value = json.loads(text)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}


def _tensors(nodes: Sequence[Any]) -> dict[str, tuple[str, int]]:
    """Element type and rank by name."""
    return {node.name: (node.type, len(node.shape)) for node in nodes}


def _check_contract(
    graph: Graph, tensors: Mapping[str, Mapping[str, tuple[str, int]]], contract: Contract, where: str
) -> None:
    """ModelError unless the graph's tensors, by kind and name, are the contract's."""
    version = graph.metadata.get("contract", CONTRACT_VERSION)
    if version != CONTRACT_VERSION:
        raise ModelError(f"contract version {str(version)[:40]}, this runtime speaks {CONTRACT_VERSION}", where=where)
    for kind, wanted in (("input", contract.inputs), ("output", contract.outputs)):
        for name, (dtype, rank) in wanted.items():
            if name not in tensors[kind]:
                have = ", ".join(other for other in tensors[kind] if other not in wanted) or "no other"
                raise ModelError(f"{kind} '{name}' is missing; it has {have[:200]}", where=where)
            found_dtype, found_rank = tensors[kind][name]
            if (found_dtype, found_rank) != (dtype, rank):
                is_, expected = f"{found_dtype} of rank {found_rank}", f"{dtype} of rank {rank}"
                raise ModelError(f"{kind} '{name}' is {is_}, expected {expected}", where=where)
        unknown = [name for name in tensors[kind] if name not in wanted]
        if kind == "input" and unknown:
            raise ModelError(f"input '{unknown[0][:60]}' is not in the contract ({', '.join(wanted)})", where=where)
