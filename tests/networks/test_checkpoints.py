"""Checkpoints: what loads, what is refused, and that reading one runs nothing it holds."""

import os
import pickle
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from scenes import refusing
from torch import Tensor

from tinysplat.checkpoints import identify, load_network, official_shapes, read_checkpoint
from tinysplat.networks import OFFICIAL
from tinysplat_runtime.errors import InputError

State = dict[str, Tensor]


def official_state(name: str, variant: str = "re10k", prefix: str = "encoder.") -> State:
    """Every tensor of a checkpoint, in a file of a few kilobytes: one number seen as a whole tensor."""
    return {prefix + k: torch.tensor(0.5).expand(shape) for k, shape in official_shapes(name, variant).items()}


def save(path: Path, content: Any) -> Path:
    torch.save(content, path)
    return path


@pytest.mark.parametrize(("name", "variant"), [key for key in OFFICIAL if key != ("mvsplat", "acid")])
def test_network_and_variant_follow_from_the_tensors(name: str, variant: str, tmp_path: Path) -> None:
    path = save(tmp_path / "weights.pth", official_state(name, variant))
    assert identify(read_checkpoint(path)) == (name, variant)


@pytest.mark.parametrize("prefix", ["encoder.", ""])
@pytest.mark.parametrize("wrap", [lambda state: state, lambda state: {"epoch": 3, "state_dict": state}])
def test_weights_arrive_whatever_the_wrapping(prefix: str, wrap: Any, tmp_path: Path) -> None:
    beside = {"loss.mean": torch.zeros(1)} if prefix else {}
    path = save(tmp_path / "re10k.ckpt", wrap(official_state("mvsplat", prefix=prefix) | beside))
    loaded = load_network(path, "mvsplat")
    assert all(bool((tensor == 0.5).all()) for tensor in loaded.module.state_dict().values())
    assert not loaded.module.training


def test_safetensors_load_alike(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    path = tmp_path / "small.safetensors"
    save_file({k: v.contiguous() for k, v in official_state("depthsplat-small", "dl3dv").items()}, path)
    loaded = load_network(path)
    assert (loaded.name, loaded.variant, loaded.scale_rule) == ("depthsplat-small", "dl3dv", "2025-04")


def test_objects_of_the_training_framework_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    framework = types.ModuleType("pytorch_lightning")
    callback = type("ModelCheckpoint", (), {"__module__": framework.__name__})
    framework.ModelCheckpoint = callback  # type: ignore[attr-defined]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, framework.__name__, framework)
        content = {"callbacks": {callback: {"best": callback()}}, "state_dict": official_state("mvsplat")}
        path = save(tmp_path / "old.ckpt", content)
    assert load_network(path).name == "mvsplat"


class Exploit:
    """Pickles as a call."""

    def __init__(self, function: Any, argument: str) -> None:
        self.call = function, (argument,)

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("function", [os.system, eval, os.makedirs])
def test_a_file_that_would_run_code_is_refused_and_runs_nothing(function: Any, tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    argument = {os.system: f"touch {trace}", eval: f"open({str(trace)!r}, 'w')"}.get(function, str(trace))
    path = save(tmp_path / "evil.ckpt", {"state_dict": official_state("mvsplat"), "hook": Exploit(function, argument)})
    with refusing(InputError, str(path)):
        read_checkpoint(path)
    assert not trace.exists()


def _damaged(path: Path) -> None:
    whole = save(path, official_state("mvsplat")).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize(
    "write",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"<html>404</html>" * 100),
        lambda path: path.write_bytes(pickle.dumps({"state_dict": {}})),
        _damaged,
        lambda path: None,
    ],
    ids=["empty", "web page", "bare pickle", "cut short", "missing"],
)
def test_files_that_are_no_checkpoints_are_refused(write: Any, tmp_path: Path) -> None:
    path = tmp_path / "some.ckpt"
    write(path)
    with pytest.raises(InputError) as caught:
        read_checkpoint(path)
    assert caught.value.where == str(path)


@pytest.mark.parametrize(
    "content",
    [
        [1, 2],
        {"state_dict": {}},
        {"lr": 0.1},
        torch.zeros(3),
        {"model": {"backbone.conv1.weight": torch.zeros(64, 3, 7, 7)}},
    ],
    ids=["list", "empty", "no tensor", "nameless", "depth only"],
)
def test_files_without_a_network_of_gaussians_are_refused(content: Any, tmp_path: Path) -> None:
    path = save(tmp_path / "some.pth", content)
    with refusing(InputError, str(path)):
        read_checkpoint(path)


def test_unknown_network_is_refused_with_those_there_are(tmp_path: Path) -> None:
    path = save(tmp_path / "resnet.pth", {"layer1.0.conv1.weight": torch.zeros(64, 64, 3, 3)})
    with pytest.raises(InputError) as caught:
        load_network(path)
    assert all(f"{name} ({variant})" in str(caught.value) for name, variant in OFFICIAL)


CONV = "encoder.backbone.backbone.conv1.weight"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda s: {name: value for name, value in s.items() if name != CONV}, "1: backbone.backbone.conv1.weight"),
        (lambda s: s | {"encoder.extra.7": torch.zeros(1)}, "1: extra.7"),
        (
            lambda s: s | {CONV: torch.zeros(64, 3, 5, 5)},
            "1: backbone.backbone.conv1.weight (64, 3, 5, 5), (64, 3, 7, 7)",
        ),
    ],
    ids=["missing", "unexpected", "reshaped"],
)
def test_differences_are_named_one_by_one(change: Any, named: str, tmp_path: Path) -> None:
    path = save(tmp_path / "re10k.ckpt", change(official_state("mvsplat")))
    with refusing(InputError, f"{path} (re10k) {named}") as caught:
        load_network(path, "mvsplat")
    assert "mvsplat" in str(caught.value)


def test_another_known_network_than_asked_for_is_named(tmp_path: Path) -> None:
    path = save(tmp_path / "small.pth", official_state("depthsplat-small"))
    with refusing(InputError, "depthsplat-small (re10k) depthsplat-base"):
        load_network(path, "depthsplat-base")


def test_published_file_with_another_hash_is_a_bad_download(tmp_path: Path) -> None:
    path = save(tmp_path / "depthsplat-gs-small-re10k-256x256-view2-cfeab6b1.pth", official_state("depthsplat-small"))
    with refusing(InputError, f"{path}: cfeab6b1"):
        read_checkpoint(path)


def test_scale_rule_of_a_published_file_follows_from_its_hash(tmp_path: Path) -> None:
    read = read_checkpoint(save(tmp_path / "renamed.pth", official_state("depthsplat-small")))
    march = replace(read, digest="20f39ed8".ljust(64, "0"))
    assert load_network(march).scale_rule == "2025-03"
    assert load_network(march, scale_rule="2025-04").scale_rule == "2025-04"
