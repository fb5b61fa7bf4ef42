"""Training of `edge`: exact depth, samples by index, exact resume, losses, and clear errors."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, trace, write_traced
from scenes import refusing
from torch import Tensor

from tinysplat.training.__main__ import main
from tinysplat.training.config import Config, DataSettings, OptimiserSettings, RunSettings, load_config
from tinysplat.training.data import SampleStream
from tinysplat.training.loop import CHECKPOINT, train, train_step
from tinysplat.training.procedural import procedural_sample
from tinysplat.training.state import TrainingState, read_checkpoint
from tinysplat.training.textures import texture_bank
from tinysplat_runtime.errors import InputError

TINY = DataSettings(side=32, large_side=32, textures=6, photo_share=0.5)
QUICK = OptimiserSettings(batch=1, steps=4, warmup=2, cooldown=2)


def write_scenes(folder: Path, scenes: int = 2, views: int = 4) -> Path:
    """Scene folders of traced photos with cameras."""
    for number in range(scenes):
        (folder / f"scene{number}").mkdir(parents=True)
        write_traced(folder / f"scene{number}", trace(views, 40, 48, spacing=0.25 + 0.05 * number), (NEAR, FAR))
    return folder


def tiny_config(photos: Path, **optimiser: int) -> Config:
    return Config(
        data=dataclasses.replace(TINY, photos=str(photos) if photos.name else ""),
        optimiser=dataclasses.replace(QUICK, **optimiser),
        run=RunSettings(device="cpu", log_steps=1),
    )


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scenes(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="module")
def textures() -> np.ndarray:
    return texture_bank([], 6, np.random.default_rng(0))


def test_exact_depth_carries_pixels_to_where_another_view_shows_the_same(textures: np.ndarray) -> None:
    errors, guesses = [], []
    for seed in range(8, 12):  # of scenes in which a wrong depth shows
        sample = procedural_sample(np.random.default_rng(seed), textures, 64, 2, [64])
        assert sample.depth is not None
        row, column = np.mgrid[:64, :64] + 0.5
        pixels = np.stack([column, row, np.ones_like(row)]).reshape(3, -1)
        K, c2w = sample.K.double().numpy(), sample.c2w.double().numpy()
        first, second = sample.images.numpy().reshape(2, 3, -1)
        for scale in (1.0, 1.5):
            local = np.linalg.solve(K[0], pixels) * (scale * sample.depth[0].numpy().reshape(1, -1))
            world = c2w[0, :3, :3] @ local + c2w[0, :3, 3:]
            there = c2w[1, :3, :3].T @ (world - c2w[1, :3, 3:])
            x, y = (K[1] @ there)[:2] / there[2]
            inside = (x > 0) & (x < 64) & (y > 0) & (y < 64)
            shown = second[:, y[inside].astype(int) * 64 + x[inside].astype(int)]
            error = np.median(np.abs(shown - first[:, inside]).mean(axis=0))
            (errors if scale == 1 else guesses).append(error)
    assert np.mean(errors) < 0.03
    assert np.mean(guesses) > 2 * np.mean(errors)


def test_a_sample_is_a_function_of_its_index(photos: Path) -> None:
    first, second = (SampleStream(dataclasses.replace(TINY, photos=str(photos))) for _ in range(2))
    names = set()
    for index in range(6):
        one, other = first.sample(index), second.sample(index)
        assert torch.equal(one.images, other.images) and torch.equal(one.c2w, other.c2w)
        assert len(one.images) == len(one.K) >= 2 and one.images.shape[1:] == (3, 32, 32) and 0 < one.near < one.far
        names.add(one.name)
    assert "procedural" in names and len(names) > 1
    assert not torch.equal(first.sample(0).images, first.sample(1).images)


def test_a_corrupt_photo_is_skipped_and_reported(tmp_path: Path) -> None:
    folder = write_scenes(tmp_path / "photos", scenes=1, views=5)
    bad = folder / "scene0" / "images" / "0002.png"
    bad.write_bytes(bad.read_bytes()[:60])
    lines: list[str] = []
    train(tiny_config(folder, steps=1), tmp_path / "run", say=lines.append)
    assert sum(str(bad) in line for line in lines) == 1


def all_weights(state: TrainingState) -> list[Tensor]:
    return [*state.network.state_dict().values(), *state.average.values()]


def test_an_interrupted_and_resumed_run_equals_an_uninterrupted_one(photos: Path, tmp_path: Path) -> None:
    config = tiny_config(photos)
    whole = train(config, tmp_path / "whole", say=lambda line: None)
    train(tiny_config(photos, steps=2, cooldown=0), tmp_path / "parts", say=lambda line: None)
    resumed = train(config, tmp_path / "parts", resume=True, say=lambda line: None)
    assert whole.step == resumed.step == 4
    assert all(torch.equal(a, b) for a, b in zip(all_weights(whole), all_weights(resumed), strict=True))
    assert (tmp_path / "parts" / CHECKPOINT).stat().st_size <= 15 * 2**20


def test_a_step_with_a_gradient_that_is_not_finite_is_left_out(photos: Path) -> None:
    config = tiny_config(photos)
    state = TrainingState.fresh(config, torch.device("cpu"))
    sample = SampleStream(config.data).sample(0)
    before = [value.clone() for value in state.network.state_dict().values()]
    broken = dataclasses.replace(sample, images=sample.images * torch.nan)
    train_step(state, [broken], config, torch.device("cpu"))
    assert (state.step, state.skipped) == (1, 1)
    assert all(torch.equal(a, b) for a, b in zip(before, state.network.state_dict().values(), strict=True))


def test_a_folder_without_scenes_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    config = tmp_path / "c.toml"
    config.write_text('[data]\nphotos = "empty"\n[run]\ndevice = "cpu"\n', "utf-8")
    assert main([str(config), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / "empty") in error and error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_checkpoint_of_another_architecture_is_one_clear_line(photos: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for content, found in (({"architecture": "other 7"}, "7"), ({"model": {}}, "")):
        torch.save(content, folder / CHECKPOINT)
        with refusing(InputError, f"{folder / CHECKPOINT} {found}"):
            train(tiny_config(photos), folder, resume=True)
    (folder / CHECKPOINT).write_bytes(b"no checkpoint at all")
    with refusing(InputError, str(folder / CHECKPOINT)):
        read_checkpoint(folder / CHECKPOINT)
    with refusing(InputError, str(tmp_path / "none")):
        train(tiny_config(photos), tmp_path / "none", resume=True)


def test_a_run_is_never_overwritten_by_a_new_one(photos: Path, tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT).write_bytes(b"weights")
    with refusing(InputError, "--resume"):
        train(tiny_config(photos), tmp_path)
    assert (tmp_path / CHECKPOINT).read_bytes() == b"weights"


@pytest.mark.parametrize(
    ("text", "place", "named"),
    [
        ("[data]\nzooms = [1.0, 8.0]", "zooms", ("0.25", "4")),
        ('[data]\nphotos = "x"\nside = 50', "side", ("50", "16")),
        ("[optimizer]\nrate = 1", "optimizer", ("data", "loss", "optimiser", "run")),
        ('[run]\nthreads = "two"', "threads", ("'two'",)),
    ],
)
def test_configurations_that_cannot_be_meant_are_refused(
    tmp_path: Path, text: str, place: str, named: tuple[str, ...]
) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError) as caught:
        load_config(path)
    assert caught.value.where.startswith(str(path)) and caught.value.where.endswith(place)
    assert all(word in caught.value.message for word in named)
