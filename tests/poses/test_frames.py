"""Frames of a video: apart by movement, sharp among their neighbours."""

from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from tinysplat.poses.frames import Walk, look_through, measured
from tinysplat_runtime.scene.footage import open_video

HEIGHT, WIDTH = 96, 192


def texture(seed: int = 0) -> NDArray:
    """(HEIGHT, 4·WIDTH) uint8 of detail at several scales."""
    rng = np.random.default_rng(seed)
    layers = [np.kron(rng.uniform(0, 60, (HEIGHT // n, 4 * WIDTH // n)), np.ones((n, n))) for n in (2, 4, 8, 16)]
    return np.sum(layers, axis=0).astype(np.uint8)


def views(places: list[float]) -> list[NDArray]:
    """Windows of the texture, whole pixels apart."""
    wall = texture()
    return [wall[:, round(x) : round(x) + WIDTH] for x in places]


def blurred(picture: NDArray) -> NDArray:
    return np.mean([np.roll(picture, shift, axis=1) for shift in range(-4, 5)], axis=0).astype(np.uint8)


@pytest.mark.parametrize("pace", [0.25, 1, 3, 9])
def test_movement_adds_up_at_any_pace(pace: float) -> None:
    frames = int(120 / pace) + 1
    moved, _ = measured(views([pace * i for i in range(frames)]))
    assert moved.shape == (frames,) and (np.diff(moved) >= 0).all()
    assert moved[-1] * WIDTH == pytest.approx(120, abs=12)


def test_blurred_frames_are_passed_over(tmp_path: Path) -> None:
    places = [2.0 * i for i in range(60)]
    pictures = [blurred(view) if i % 3 else view for i, view in enumerate(views(places))]
    with av.open(str(tmp_path / "clip.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"crf": "15"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.stack([picture] * 3, -1), format="rgb24")))
        container.mux(stream.encode())
    video = open_video(tmp_path / "clip.mp4")
    walk = look_through(video)
    chosen = walk.chosen(10)
    assert len(chosen) == 10 and all(i % 3 == 0 for i in chosen)
    found = dict(video.frames(chosen))
    assert list(found) == chosen
    assert np.abs(found[chosen[3]][..., 0] - pictures[chosen[3]].astype(float)).mean() < 8
    assert 2 <= len(walk.chosen()) < 60  # as many as its movement asks for


def test_of_frames_that_hardly_overlap_all_are_taken() -> None:
    rng = np.random.default_rng(0)
    jumps = [
        np.clip(view + rng.normal(0, 4, view.shape), 0, 255).astype(np.uint8)
        for view in views([40.0 * i for i in range(14)])
    ]
    walk = Walk(list(range(14)), *measured(jumps))
    assert walk.chosen() == list(range(14))


def test_more_frames_come_from_beside_those_that_are_missing() -> None:
    walk = Walk(list(range(0, 400, 2)), np.linspace(0, 10, 200), np.ones(200))
    chosen = walk.chosen(20)
    missing = set(chosen[4:8])
    added = walk.between(chosen, missing)
    assert added == sorted(set(added) - set(chosen)) and all(index % 2 == 0 for index in added)
    assert all(chosen[3] < index < chosen[8] for index in added)
    assert all(any(a < index < b for index in added) for a, b in pairwise(chosen[3:9]))
    assert len(walk.between(chosen, set(chosen), most=27)) == 7
    assert walk.between(walk.chosen(200), missing) == []  # there are none between
