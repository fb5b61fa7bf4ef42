"""What is pinned on purpose: planes, whole files, messages and contracts of graphs; test and regenerator read them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from console import tinysplat
from numpy.typing import NDArray
from scenes import list_in_tiers, make_list, make_smooth_gaussians, write_scene

from tinysplat_runtime import compress
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.artifacts import load_manifest
from tinysplat_runtime.graphs.inference import open_graph
from tinysplat_runtime.scene.cameras import Camera

DATA = Path(__file__).parent / "data"


def _all(gaussians: Gaussians, profile: str, qp: float) -> bytes:
    return compress(gaussians, profile, qp, keep_all=True)


@dataclass(frozen=True)
class FileCase:
    """A scene, and how it is coded."""

    name: str
    make: Callable[[], Gaussians]
    profile: str
    qp: float
    code: Callable[[Gaussians, str, float], bytes] = _all


def _view_dependent() -> Gaussians:
    """Two layers whose views disagree about colours, so that SH coefficients stay."""
    scene = make_smooth_gaussians(2, 24, 40, 1, seed=5, layers=2)
    return replace(scene, sh=scene.sh * np.array([1, 8, 8, 8], np.float32)[:, None])


def _in_tiers(gaussians: Gaussians, _: str, qp: float) -> bytes:
    return list_in_tiers(gaussians, qp)


def _example() -> Gaussians:
    """One Gaussian whose numbers are sums of few powers of two: docs/FORMAT.md, "Worked example"."""
    camera = Camera([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], np.eye(4), 1, 1)
    numbers = [[0.25, -0.5, 2], [1, 0, 0, 0], [0.5, 0.25, 0.125]]
    means, quats, scales = (np.float32(values).reshape(1, 1, 1, -1) for values in numbers)
    sh = np.float32([0.5, 0.25, -0.5]).reshape(1, 1, 1, 1, 3)
    return Gaussians(means, quats, scales, np.full((1, 1, 1), 0.75, np.float32), sh, (camera,))


FILES = [
    FileCase("example", _example, "paper", 0),
    FileCase("tiny_paper", lambda: make_smooth_gaussians(1, 5, 7, 0, seed=3), "paper", 0),
    FileCase("degree2_paper", lambda: make_smooth_gaussians(2, 24, 40, 2, seed=4), "paper", 3),
    FileCase("degree1_balanced", _view_dependent, "balanced", 0),
    FileCase("tiers_balanced", lambda: make_list(400, 1, np.random.default_rng(8)), "balanced", 6, _in_tiers),
    FileCase("list_balanced", lambda: make_list(300, 1, np.random.default_rng(6)), "balanced", 0),
]


def golden_planes() -> dict[str, tuple[NDArray, int]]:
    """Integer planes and their QP: made of integers alone, so that every machine has the same."""
    v, u = np.mgrid[:40, :56]
    ramp = (u * 61 + v * 17) % 4096
    steps = np.where((u // 9 + v // 7) % 2 == 0, 700, 3100)
    hashed = (u * 2654435761 + v * 40503) % 977 + 1500
    return {
        "ramp": (ramp.astype(np.uint16), 8),
        "steps": (steps.astype(np.uint16), 20),
        "noise": (hashed.astype(np.uint16), 24),
    }


def golden_messages() -> str:
    """What commands say of faults that users meet: each command, then its line."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        whole = (DATA / "tiny_paper.tsplat").read_bytes()
        (folder / "whole.tsplat").write_bytes(whole)
        (folder / "cut.tsplat").write_bytes(whole[:-9])
        (folder / "damaged.tsplat").write_bytes(whole[:-3] + b"!!!")
        (folder / "photo.tsplat").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(99))
        write_scene(folder / "scene", views=2)
        (folder / "scene" / "images" / "0001.png").unlink()
        commands = (
            "info nowhere.tsplat",
            "info cut.tsplat",
            "decode damaged.tsplat -o a.npz",
            "info photo.tsplat",
            "decode whole.tsplat -o a.obj",
            "decode whole.tsplat -o whole.tsplat",
            "render whole.tsplat -o a.bmp",
            "encode scene -o a.tsplat",
            "encode scene -o a.tsplat --qp 99",
            "compress whole.tsplat -o a.tsplat --target-size 9",
            "decode whole.tsplat -o no/such/folder.npz",
        )
        said = []
        for command in commands:
            words = [str(folder / word) if "." in word or word == "scene" else word for word in command.split()]
            said.append(f"$ tinysplat {command}\n{tinysplat(*words).stderr.strip()}")
        return ("\n".join(said) + "\n").replace(f"{folder}/", "")


def golden_contracts() -> str:
    """Names, types and ranks of what goes into and comes out of every graph that ships."""
    lines = []
    for name, artifact in sorted(load_manifest().items()):
        contract = {"network": "network", "stage": f"stage_{name.rpartition('_')[2]}"}.get(artifact.role or "", name)
        session = open_graph(artifact, contract, threads=1).session
        lines.append(f"{name} ({artifact.role})")
        for way, ports in (("in", session.get_inputs()), ("out", session.get_outputs())):
            lines += [f"  {way:3} {port.name}: {port.type}, rank {len(port.shape)}" for port in ports]
    return "\n".join(lines) + "\n"
