"""Videos decode to the frames that went in, are streamed, and are whole or absent."""

import errno
import resource
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render.video import write_video


def frames_of(count: int, height: int, width: int) -> list[NDArray]:
    """Smooth (height, width, 3) float32 pictures with saturated colours that move from frame to frame."""
    y, x = np.mgrid[0:height, 0:width] / 24
    return [
        np.stack([np.sin(x + t / 4), np.cos(y - t / 5), np.sin(x + y)], -1).astype(np.float32) / 2 + 0.5
        for t in range(count)
    ]


def decoded(path: Path) -> tuple[list[NDArray], Any]:
    """RGB frames (H, W, 3) in [0, 1], from limited-range BT.709 with each chroma sample repeated, and the stream."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [to_rgb(frame) for frame in container.decode(stream)], stream


def to_rgb(frame: Any) -> NDArray:
    planes = frame.to_ndarray().astype(float)  # (3H/2, W): Y, then Cb, then Cr
    half = (frame.height // 2, frame.width // 2)
    y = (planes[: frame.height] - 16) / 219
    cb, cr = (
        (c.reshape(half).repeat(2, 0).repeat(2, 1) - 128) / 224 for c in np.split(planes[frame.height :].ravel(), 2)
    )
    red, blue = y + 1.5748 * cr, y + 1.8556 * cb
    return np.stack([red, (y - 0.2126 * red - 0.0722 * blue) / 0.7152, blue], -1)


@pytest.mark.parametrize("size", [(48, 64), (47, 63), (2, 2), (1, 1)])
def test_video_shows_the_frames_that_went_in(tmp_path: Path, size: tuple[int, int]) -> None:
    frames = frames_of(7, *size)
    write_video(tmp_path / "a.mp4", iter(frames), fps=25)
    shown, stream = decoded(tmp_path / "a.mp4")
    assert stream.codec_context.name == "h264" and stream.average_rate == 25
    context = stream.codec_context
    assert (context.color_range, context.color_primaries, context.color_trc, context.colorspace) == (1, 1, 1, 1)
    assert context.pix_fmt == "yuv420p"
    assert len(shown) == 7
    for image, expected in zip(shown, frames, strict=True):
        assert image.shape == (*(n + n % 2 for n in size), 3)
        difference = image[: size[0], : size[1]] - expected
        assert np.sqrt((difference**2).mean()) < 0.02  # of 1: chroma at half resolution and crf 18


@pytest.mark.parametrize("fps", [12.5, 30000 / 1001, 0.5])
def test_frame_rate_is_kept(tmp_path: Path, fps: float) -> None:
    write_video(tmp_path / "a.mp4", frames_of(4, 16, 16), fps=fps)
    assert float(decoded(tmp_path / "a.mp4")[1].average_rate) == pytest.approx(fps, rel=1e-3)


def test_frames_are_dropped_once_encoded(tmp_path: Path) -> None:
    alive: list[weakref.ref[NDArray]] = []

    def stream() -> Iterator[NDArray]:
        for image in frames_of(40, 16, 16):
            copy = image.copy()
            alive.append(weakref.ref(copy))
            yield copy
            del copy
            assert sum(ref() is not None for ref in alive) <= 2

    write_video(tmp_path / "a.mp4", stream())
    assert len(alive) == 40


@pytest.mark.parametrize("failure", [KeyboardInterrupt, ValueError, InputError])
def test_failing_renderer_leaves_no_file(tmp_path: Path, failure: type[BaseException]) -> None:
    def stream() -> Iterator[NDArray]:
        yield from frames_of(2, 16, 16)
        raise failure("midway")

    with pytest.raises(failure):
        write_video(tmp_path / "a.mp4", stream())
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_video_is_refused_by_name(tmp_path: Path) -> None:
    good = frames_of(1, 8, 8)
    cases: list[tuple[str, list[NDArray], float, str]] = [
        ("a.mp4", [], 30, ""),
        ("a.mp4", [good[0], np.zeros((8, 9, 3), np.float32)], 30, r"frame 1 of shape \(8, 9, 3\)"),
        ("a.mp4", [np.zeros((8, 8), np.float32)], 30, r"expected \(H, W, 3\)"),
        ("a.mp4", [np.full((8, 8, 3), np.nan)], 30, "NaN"),
        ("a.mp4", good, 0, "0"),
        ("a.mp4", good, 1000, "1000"),
        ("a.mp4", [np.zeros((8, 8, 4), np.float32)], 30, r"frame of shape \(8, 8, 4\)"),
        ("a.mp4", [np.zeros((0, 8, 3), np.float32)], 30, r"frame of shape \(0, 8, 3\)"),
        ("a.mp4", [*good, *good, np.zeros((9, 8, 3), np.float32)], 30, r"frame 2 of shape \(9, 8, 3\)"),
        ("a.mp4", good, float("nan"), "nan"),
        ("a.gif", good, 30, ".mp4"),
    ]
    for name, frames, fps, words in cases:
        with refusing(InputError, words) as caught:
            write_video(tmp_path / name, frames, fps)
        assert caught.value.where == str(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit", [0, 100, 1500, 4000])
def test_disk_that_fills_up_is_an_oserror_that_names_the_file(tmp_path: Path, limit: int) -> None:
    target = tmp_path / "a.mp4"
    frames = [np.random.default_rng(t).random((32, 32, 3), np.float32) for t in range(9)]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        with pytest.raises(OSError) as caught:
            write_video(target, frames)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.filename == str(target) and caught.value.errno == errno.EFBIG
    assert list(tmp_path.iterdir()) == []


def test_a_video_plays_before_all_of_it_is_there(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", frames_of(5, 16, 16))
    data = (tmp_path / "a.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
