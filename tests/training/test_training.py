"""Training of `edge`: exact depth, samples by index, exact resume, losses, and clear errors."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, trace
from torch import Tensor

from tinysplat.networks.edge import Edge
from tinysplat.training.__main__ import main
from tinysplat.training.config import Config, DataSettings, OptimiserSettings, RunSettings, load_config
from tinysplat.training.data import SampleStream
from tinysplat.training.loop import CHECKPOINT, CURVES, train
from tinysplat.training.losses import LossWeights, candidate_entropy, losses, photometric, rate
from tinysplat.training.pack import main as pack_main
from tinysplat.training.photos import PhotoSet, scene_folders
from tinysplat.training.procedural import procedural_sample
from tinysplat.training.samples import Sample, psnr, render_outputs
from tinysplat.training.state import TrainingState, read_checkpoint
from tinysplat.training.textures import SIZE, texture_bank
from tinysplat.training.validation import validation_samples
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import write_png

TINY = DataSettings(side=32, large_side=32, textures=6, photo_share=0.5)
QUICK = OptimiserSettings(batch=1, steps=4, warmup=2, cooldown=2)


def write_scenes(folder: Path, scenes: int = 2, views: int = 4) -> Path:
    """Scene folders of traced photos with cameras."""
    for number in range(scenes):
        scene = trace(views, 40, 48, spacing=0.25 + 0.05 * number)
        path = folder / f"scene{number}"
        (path / "images").mkdir(parents=True)
        frames = []
        for i, (image, camera) in enumerate(zip(scene.images, scene.cameras, strict=True)):
            write_png(path / "images" / f"{i}.png", (image * 255).round().astype(np.uint8))
            frames.append(
                {
                    "file": f"images/{i}.png",
                    "width": 48,
                    "height": 40,
                    "K": camera.K.tolist(),
                    "c2w": camera.c2w.tolist(),
                }
            )
        document = {"near": NEAR, "far": FAR, "frames": frames}
        (path / "cameras.json").write_text(json.dumps(document), "utf-8")
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


def test_textures_are_made_without_any_photos(textures: np.ndarray) -> None:
    assert textures.shape == (6, SIZE, SIZE, 3) and textures.dtype == np.uint8
    assert all(np.ptp(texture) > 0 for texture in textures)


def test_further_pictures_become_textures_and_unreadable_ones_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    write_png(tmp_path / "deep" / "red.png", np.full((300, 400, 3), (200, 10, 10), np.uint8))
    (tmp_path / "bad.jpg").write_bytes(b"no picture")
    (tmp_path / "notes.txt").write_text("no picture either", "utf-8")
    bank = texture_bank([], 120, np.random.default_rng(0), tmp_path)
    assert sum(bool((np.abs(texture - (200.0, 10.0, 10.0)) < 2).all()) for texture in bank) >= 1


def test_a_folder_without_pictures_is_one_clear_line(photos: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no picture that can be read, expected"):
        SampleStream(dataclasses.replace(TINY, photos=str(photos), pictures=str(tmp_path)))


def test_exact_depth_carries_pixels_to_where_another_view_shows_the_same(textures: np.ndarray) -> None:
    errors, guesses = [], []
    for seed in range(4):
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


def test_samples_come_in_order_from_any_start(photos: Path) -> None:
    stream = SampleStream(dataclasses.replace(TINY, photos=str(photos)))
    following = stream.follow(3)
    for index in (3, 4):
        assert torch.equal(next(following).images, stream.sample(index).images)


def test_targets_of_photos_stand_between_their_contexts(photos: Path) -> None:
    sample = PhotoSet.load(photos).sample(np.random.default_rng(0), 32, 2, [32])
    (first, second), target = sample.c2w[:, :3, 3], sample.targets[0].c2w[:3, 3]
    along = torch.dot(target - first, second - first) / (second - first).square().sum()
    assert -0.1 < float(along) < 1.1
    assert float((first + second).abs().max()) < 1e-5  # relative to the mean centre of the contexts


def test_a_corrupt_photo_is_skipped_and_counted_and_reported(tmp_path: Path) -> None:
    folder = write_scenes(tmp_path / "photos", scenes=1, views=5)
    bad = folder / "scene0" / "images" / "2.png"
    bad.write_bytes(bad.read_bytes()[:60])
    lines: list[str] = []
    train(tiny_config(folder, steps=1), tmp_path / "run", say=lines.append)
    assert any("2.png" in line and line.startswith("skipped") for line in lines)
    assert any("1 scenes, 1 photos skipped" in line for line in lines)


def all_weights(state: TrainingState) -> list[Tensor]:
    return [*state.network.state_dict().values(), *state.average.values()]


def test_an_interrupted_and_resumed_run_equals_an_uninterrupted_one(photos: Path, tmp_path: Path) -> None:
    config = tiny_config(photos)
    whole = train(config, tmp_path / "whole", say=lambda line: None)
    train(tiny_config(photos, steps=2, cooldown=0), tmp_path / "parts", say=lambda line: None)
    resumed = train(config, tmp_path / "parts", resume=True, say=lambda line: None)
    assert whole.step == resumed.step == 4 and len(whole.history) == len(resumed.history) == 4
    assert all(torch.equal(a, b) for a, b in zip(all_weights(whole), all_weights(resumed), strict=True))
    moments = [list(state.optimiser.state_dict()["state"].values()) for state in (whole, resumed)]
    assert all(torch.equal(a["exp_avg_sq"], b["exp_avg_sq"]) for a, b in zip(*moments, strict=True))
    assert (tmp_path / "parts" / CURVES).stat().st_size > 1000
    assert (tmp_path / "parts" / CHECKPOINT).stat().st_size <= 15 * 2**20


def test_training_is_stopped_after_so_many_steps_as_if_interrupted(photos: Path, tmp_path: Path) -> None:
    config, lines = tiny_config(photos), list[str]()
    whole = train(config, tmp_path / "whole", say=lambda line: None)
    train(config, tmp_path / "parts", steps=3, say=lines.append)
    assert lines[-1] == f"step 3: {tmp_path / 'parts' / CHECKPOINT}"
    resumed = train(config, tmp_path / "parts", resume=True, steps=9, say=lambda line: None)
    assert resumed.step == whole.step == 4
    assert all(torch.equal(a, b) for a, b in zip(all_weights(whole), all_weights(resumed), strict=True))


def test_training_is_stopped_by_its_minutes_and_leaves_a_checkpoint(photos: Path, tmp_path: Path) -> None:
    state = train(tiny_config(photos), tmp_path / "run", minutes=0.0, say=lambda line: None)
    assert state.step == 0
    assert read_checkpoint(tmp_path / "run" / CHECKPOINT)["step"] == 0


def test_a_step_with_a_gradient_that_is_not_finite_is_left_out(photos: Path) -> None:
    from tinysplat.training.loop import train_step

    config = tiny_config(photos)
    state = TrainingState.fresh(config, torch.device("cpu"))
    sample = SampleStream(config.data).sample(0)
    before = [value.clone() for value in state.network.state_dict().values()]
    broken = dataclasses.replace(sample, images=sample.images * torch.nan)
    train_step(state, [broken], config, torch.device("cpu"))
    assert (state.step, state.skipped) == (1, 1)
    assert all(torch.equal(a, b) for a, b in zip(before, state.network.state_dict().values(), strict=True))


def test_steps_on_one_sample_make_its_picture_better(photos: Path) -> None:
    config = tiny_config(photos)
    state = TrainingState.fresh(config, torch.device("cpu"))
    sample = SampleStream(config.data).sample(0)
    found = []
    for _ in range(25):
        loss, _ = losses(state.network.predict(*sample.inputs()), sample, config.loss)
        state.optimiser.zero_grad()
        loss.backward()
        state.optimiser.step()
        found.append(float(loss.detach()))
    assert found[-1] < found[0] - 0.05, found


def flat_prediction(photos: Path) -> tuple[object, Sample]:
    state = TrainingState.fresh(tiny_config(photos), torch.device("cpu"))
    sample = SampleStream(dataclasses.replace(TINY, photos=str(photos))).sample(0)
    with torch.no_grad():
        return state.network.predict(*sample.inputs()), sample


def test_the_rate_is_zero_for_constant_planes_and_grows_with_noise(photos: Path) -> None:
    prediction, _ = flat_prediction(photos)
    names = ("level", "footprint", "opacity", "colours")
    constant = {name: torch.full_like(getattr(prediction, name), 0.3) for name in names}
    flat = dataclasses.replace(prediction, **constant)
    noisy = [
        dataclasses.replace(flat, opacity=constant["opacity"] + amount * torch.randn_like(constant["opacity"]))
        for amount in (0.1, 1.0)
    ]
    bits = [float(rate(p)) for p in (flat, *noisy)]
    assert bits[0] == pytest.approx(0, abs=1e-5)
    assert bits[0] < bits[1] < bits[2]


def test_the_photometric_loss_is_zero_for_equal_pictures_alone() -> None:
    picture = torch.rand(3, 8, 8)
    assert float(photometric(picture, picture, LossWeights())) == 0
    weights = LossWeights(l1=1, squared=0, gradient=1, decibel=0)
    assert float(photometric(picture + 0.1, picture, weights)) == pytest.approx(0.1, abs=1e-6)


def test_the_entropy_is_least_at_the_true_candidates() -> None:
    truth, known = torch.full((1, 1, 4, 4), 2.25), torch.ones(1, 1, 4, 4)
    logits = torch.full((1, 6, 2, 2), -20.0)
    logits[:, 2], logits[:, 3] = np.log(0.75), np.log(0.25)
    best = float(candidate_entropy(logits, truth, known))
    assert best == pytest.approx(-0.75 * np.log(0.75) - 0.25 * np.log(0.25), abs=1e-4)
    assert float(candidate_entropy(logits.roll(1, dims=1), truth, known)) > best + 1
    assert float(candidate_entropy(logits, truth, 0 * known)) == 0


def test_a_network_in_training_draws_the_scene_it_was_given(photos: Path) -> None:
    prediction, sample = flat_prediction(photos)
    target = sample.targets[0]
    assert psnr(render_outputs(prediction.outputs, target.camera()), target.image) > 12


def test_a_single_scene_is_taken_as_it_is(photos: Path, tmp_path: Path) -> None:
    (only,) = scene_folders(photos)[:1]
    assert [scene.name for scene in PhotoSet.load(only).scenes] == [PhotoSet.load(photos).scenes[0].name]
    with pytest.raises(InputError, match=r"no scene folder with eval_index\.json"):
        list(validation_samples(tmp_path, ("near",), (64, 64)))


def test_a_folder_without_scenes_is_one_clear_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    config = tmp_path / "c.toml"
    config.write_text('[data]\nphotos = "empty"\n[run]\ndevice = "cpu"\n', "utf-8")
    assert main([str(config), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert "empty: no scene folders, expected" in error and error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_checkpoint_of_another_architecture_is_one_clear_line(photos: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for content, found in (({"architecture": "other 7"}, "other 7"), ({"model": {}}, "something else")):
        torch.save(content, folder / CHECKPOINT)
        with pytest.raises(InputError, match=f"a checkpoint of {found}, expected tinysplat edge"):
            train(tiny_config(photos), folder, resume=True)
    (folder / CHECKPOINT).write_bytes(b"no checkpoint at all")
    with pytest.raises(InputError, match=r"edge\.pt: not a checkpoint"):
        read_checkpoint(folder / CHECKPOINT)
    with pytest.raises(InputError, match="no such file"):
        train(tiny_config(photos), tmp_path / "none", resume=True)


def test_a_run_is_never_overwritten_by_a_new_one(photos: Path, tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT).write_bytes(b"weights")
    with pytest.raises(InputError, match="expected --resume or another folder"):
        train(tiny_config(photos), tmp_path)
    assert (tmp_path / CHECKPOINT).read_bytes() == b"weights"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("data = ", "not TOML"),
        ("[data]\nzooms = [1.0, 8.0]", "data.zooms: .*expected numbers from 0.25 to 4"),
        ("[data]\nzooms = 2.0", "zooms: 2.0, expected a list"),
        ('[data]\nphotos = "x"\nside = 50', "data.side: 50, expected a multiple of 16"),
        ("[optimizer]\nrate = 1", "optimizer: unknown key, expected one of data, loss, optimiser, run"),
        ('[run]\nthreads = "two"', "threads: 'two', expected int"),
        ("loss = 3", "loss: expected a table"),
    ],
)
def test_configurations_that_cannot_be_meant_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=message):
        load_config(path)


def test_folders_of_a_configuration_are_relative_to_it(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text('[data]\nphotos = "scenes"\nvalidation = "dev"\n[optimiser]\nrate = 1\n', "utf-8")
    config = load_config(path)
    assert config.data.photos == str(tmp_path / "scenes") and config.data.validation == str(tmp_path / "dev")
    assert config.optimiser.rate == 1.0


def test_what_an_option_names_takes_the_place_of_the_configuration(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text('[data]\nphotos = "scenes"\n[run]\ndevice = "cuda"\n', "utf-8")
    config = load_config(path, photos="other/place", device="cpu")
    assert (config.data.photos, config.run.device) == ("other/place", "cpu")


def test_targets_have_the_sizes_that_are_asked_for(photos: Path, textures: np.ndarray) -> None:
    made = procedural_sample(np.random.default_rng(1), textures, 32, 3, [16, 64])
    taken = PhotoSet.load(photos).sample(np.random.default_rng(1), 32, 3, [16, 64])
    assert [target.image.shape[-1] for target in made.targets] == [16, 64]
    assert [target.image.shape[-1] for target in taken.targets] == [16, 40]  # a photo of 40 rows is not enlarged
    for sample in (made, taken):
        assert len(sample.images) == 3
        for target in sample.targets:
            field = target.image.shape[-1] / float(target.K[0, 0])
            assert 0.3 < field * float(sample.K[0, 0, 0]) / 32 < 3
    assert made.targets[1].K[0, 0] == pytest.approx(4 * float(made.targets[0].K[0, 0]))


def test_labels_of_depth_lie_where_their_photo_is_cropped(tmp_path: Path) -> None:
    from PIL import Image

    folder = write_scenes(tmp_path, scenes=1)
    labels = folder / "scene0" / "depth_mvs"
    labels.mkdir()
    (labels / "depth.json").write_text('{"step": 0.001}', "utf-8")
    exact = trace(4, 40, 48, spacing=0.25).depth
    for i, depth in enumerate(exact):
        Image.fromarray((1000 / depth).round().astype(np.uint16)).save(labels / f"{i}.png")
    sample = PhotoSet.load(folder).sample(np.random.default_rng(2), 32, 2, [32])
    assert sample.depth is not None
    # carried by them, a pixel finds its own colour in the other view
    row, column = np.mgrid[:32, :32] + 0.5
    rays = np.linalg.solve(sample.K[0].double().numpy(), np.stack([column, row, np.ones_like(row)]).reshape(3, -1))
    c2w = sample.c2w.double().numpy()
    world = c2w[0, :3, :3] @ (rays * sample.depth[0].double().numpy().reshape(1, -1)) + c2w[0, :3, 3:]
    x, y, z = sample.K[1].double().numpy() @ c2w[1, :3, :3].T @ (world - c2w[1, :3, 3:])
    x, y = (x / z).astype(int), (y / z).astype(int)
    inside = (x > 0) & (x < 32) & (y > 0) & (y < 32)
    first, second = sample.images.numpy().reshape(2, 3, -1)
    error = np.abs(second[:, y[inside] * 32 + x[inside]] - first[:, inside]).mean()
    assert inside.mean() > 0.5 and error < 0.5 * np.abs(second - first).mean()


def test_packed_scenes_give_the_samples_of_their_folder(photos: Path, tmp_path: Path) -> None:
    archive = tmp_path / "data.zip"
    assert pack_main([str(photos), "-o", str(archive)]) == 0
    settings = dataclasses.replace(TINY, photos=str(photos), photo_share=1.0)
    packed = SampleStream(dataclasses.replace(settings, photos=str(archive)))
    for index in range(3):
        assert torch.equal(packed.sample(index).images, SampleStream(settings).sample(index).images)
    archive.write_bytes(archive.read_bytes()[:100])
    with pytest.raises(InputError, match=r"not a \.zip"):
        SampleStream(dataclasses.replace(settings, photos=str(archive)))


def test_heads_alone_are_trained_from_the_weights_of_another_run(photos: Path, tmp_path: Path) -> None:
    first = train(tiny_config(photos, steps=1), tmp_path / "first", say=lambda line: None)
    config = tiny_config(photos, steps=2)
    config = dataclasses.replace(config, optimiser=dataclasses.replace(config.optimiser, heads_alone=True))
    second = train(config, tmp_path / "second", start=tmp_path / "first" / CHECKPOINT, say=lambda line: None)
    changed = {n.split(".")[0] for n, v in second.network.state_dict().items() if not torch.equal(v, first.average[n])}
    assert changed == {"fine", "head", "coarse"}


def test_whatever_a_step_makes_lies_on_its_device() -> None:
    with torch.device("meta"):
        network = Edge()
        views = (torch.rand(2, 3, 32, 48), torch.rand(2, 3, 3), torch.rand(2, 4, 4), torch.rand(2), torch.rand(2))
        prediction = network.predict(*views)
    assert all(output.device.type == "meta" for output in prediction.outputs)
