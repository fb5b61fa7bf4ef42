"""Videos with poses: the frame that a pose is of arrives, whatever lies between key frames; faults are one line."""

import json
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_cameras, realestate_line, refusing

from tinysplat_runtime.cli import main
from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.render.video import write_video
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.intake.cameras_json import camera_entry
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.intake.video import video_scene

HEIGHT, WIDTH, COUNT, FPS = 32, 48, 40, 25
CAMERAS = make_cameras(COUNT, HEIGHT, WIDTH)


def picture(i: int) -> NDArray:
    """Grey that tells the frame's number, brighter on the left half by a tenth."""
    image = np.full((HEIGHT, WIDTH, 3), (i + 5) / 64, np.float32)
    image[:, : WIDTH // 2] += 0.1
    return image


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    write_video(path, map(picture, range(COUNT)), fps=FPS)
    return path


def number_of(image: NDArray) -> int:
    """Which of `picture`'s frames an image in [0, 1] is."""
    return round(float(image[:, WIDTH // 2 + 4 :].mean()) * 64) - 5


def write_poses(path: Path, stamps: dict[int, int]) -> Path:
    """A RealEstate10K file: cameras by number and the time of each in microseconds."""
    path.write_text("\n".join(["https://x", *(realestate_line(t, CAMERAS[i]) for i, t in stamps.items())]))
    return path


def write_cameras(folder: Path, names: dict[str, Camera], **changes: Any) -> Path:
    frames = [{**camera_entry(name, camera), **changes} for name, camera in names.items()]
    (folder / "cameras.json").write_text(json.dumps({"near": 1.0, "far": 9.0, "frames": frames}))
    return folder


def test_any_frame_is_decoded_by_its_number(clip: Path) -> None:
    video = open_video(clip)
    assert (len(video.stamps), video.height, video.width) == (COUNT, HEIGHT, WIDTH)
    assert [number_of(video.frame(i) / 255) for i in (0, 1, 7, 30, COUNT - 1, 2)] == [0, 1, 7, 30, COUNT - 1, 2]


def test_clips_of_one_key_frame_are_read(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "short.mov"), "w") as container:
        stream: Any = container.add_stream("libx264", rate=FPS)
        stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "yuv420p"
        stream.options = {"x264-params": "keyint=1000:scenecut=0"}
        for i in range(COUNT):
            shown = av.VideoFrame.from_ndarray((255 * picture(i)).astype(np.uint8)).reformat(format="yuv420p")
            shown.pts, shown.time_base = 90 * i + i % 3, Fraction(1, 90 * FPS)  # of a varying rate
            container.mux(stream.encode(shown))
        container.mux(stream.encode(None))
    video = open_video(tmp_path / "short.mov")
    assert (len(video.stamps), video.height, video.width) == (COUNT, HEIGHT, WIDTH)
    for i in (0, COUNT - 1, 17):
        assert abs(number_of(video.frame(i) / 255) - i) <= 1


def test_realestate_poses_choose_frames_by_their_time(clip: Path, tmp_path: Path) -> None:
    stamps = {i: i * 1_000_000 // FPS + 3000 for i in (3, 21, 39)}  # 3 ms beside the frames' own times
    poses = write_poses(tmp_path / "poses.txt", stamps)
    scene = video_scene(clip, poses, near=1.0, far=9.0)
    assert [number_of(image) for image in scene.images()] == [3, 21, 39]
    for camera, i in zip(scene.cameras, (3, 21, 39), strict=True):
        np.testing.assert_allclose(camera.K, CAMERAS[i].K, atol=1e-9)
        np.testing.assert_allclose(camera.c2w, CAMERAS[i].c2w, atol=1e-9)
    assert scene.resized(16, 16).images().shape == (3, 16, 16, 3)


def test_a_video_beside_a_realestate_file_stands_for_its_photos(clip: Path, tmp_path: Path) -> None:
    poses = write_poses(tmp_path / "clip.txt", {0: 0, 4: 160_000})
    with refusing(InputError, str(poses)):
        load_scene(poses)
    (tmp_path / "clip.mp4").symlink_to(clip)
    assert [number_of(image) for image in load_scene(poses).images()] == [0, 4]


@pytest.mark.parametrize("first", [0, 1])
def test_other_poses_name_frames_by_number(clip: Path, tmp_path: Path, first: int) -> None:
    named = {f"images/frame_{i + first:05}.png": CAMERAS[i] for i in (2, 12)}
    scene = video_scene(clip, write_cameras(tmp_path, named), first_number=first)
    assert [number_of(image) for image in scene.images()] == [2, 12] and scene.depth_range() == (1.0, 9.0)


def test_frames_are_turned_as_players_turn_them(clip: Path, tmp_path: Path) -> None:
    data = bytearray(clip.read_bytes())
    straight = struct.pack(">9i", 1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
    turned = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)  # by 90 degrees, clockwise
    at = data.index(straight, data.index(b"tkhd"))
    data[at : at + len(turned)] = turned
    (tmp_path / "turned.mp4").write_bytes(data)
    video = open_video(tmp_path / "turned.mp4")
    assert (video.height, video.width) == (WIDTH, HEIGHT)
    image = video.frame(0) / 255.0
    assert image[: WIDTH // 2 - 4].mean() > image[WIDTH // 2 + 4 :].mean() + 0.08  # left has become top


def test_the_command_encodes_a_video_with_poses(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = write_poses(tmp_path / "poses.txt", {0: 0, 8: 320_000})
    out, depths = str(tmp_path / "f.tsplat"), ["--near", "1", "--far", "9"]
    assert main(["encode", str(clip), "--poses", str(poses), "-o", out, *depths]) == 0
    assert main(["encode", str(clip), "-o", out, "--force", *depths]) == 2
    assert "--poses" in capsys.readouterr().err
    assert main(["encode", str(clip), str(clip), "--poses", str(poses), "-o", out, "--force"]) == 2
    assert "poses" in capsys.readouterr().err


def test_poses_that_the_video_has_no_frames_for_are_named(clip: Path, tmp_path: Path) -> None:
    late = write_poses(tmp_path / "late.txt", {0: 0, 1: 9_000_000})
    with refusing(InputError, f"{late} 3 {clip} 9"):
        video_scene(clip, late)
    folder = tmp_path
    for names, changes, first, words in (
        (["f_39.png", "f_40.png"], {}, 0, f"f_40.png {clip} 40 of 0 to 39"),
        (["0.png"], {}, 1, "0.png -1"),
        (["desk.png"], {}, 0, "desk.png"),
        (["0.png"], {"width": 64}, 0, "48x32 64x32"),
    ):
        write_cameras(folder, dict(zip(names, CAMERAS, strict=False)), **changes)
        with refusing(InputError, words):
            video_scene(clip, folder, first_number=first)
    with refusing(InputError, f"{tmp_path / 'photo.png'} .mp4"):
        video_scene(tmp_path / "photo.png", late)


def test_what_is_no_video_is_one_line(clip: Path, tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    data = clip.read_bytes()
    playlist = f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{clip}\n#EXT-X-ENDLIST\n".encode()  # names another file
    for attack in (b"", b"not a video", data[:40], playlist):
        path.write_bytes(attack)
        with refusing(InputError, str(path)) as caught:
            open_video(path)
        assert "\n" not in str(caught.value)
    with refusing(InputError, f"{tmp_path / 'gone.mp4'}"):
        open_video(tmp_path / "gone.mp4")
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with refusing(InputError, str(path)):
        open_video(path)


def patches() -> NDArray:
    """(8, 8, 3) sRGB of greys up to white, and of colours by chance."""
    colours = np.random.default_rng(0).integers(60, 236, (8, 8, 3))
    colours[0] = np.linspace(0, 255, 8)[:, None]
    return colours.astype(np.uint8)


CODES = {  # name: primaries, transfer and matrix of ITU-T H.273, the luma weights of red and blue
    "BT.709": (1, 1, 1, 0.2126, 0.0722),
    "HLG": (9, 18, 9, 0.2627, 0.0593),
    "PQ": (9, 16, 9, 0.2627, 0.0593),
    "BT.2020": (9, 14, 9, 0.2627, 0.0593),
}


def write_patches(path: Path, kind: str, *, is_full: bool = False, times_white: float = 1.0) -> None:
    """Five frames of `patches`, 16 pixels each, of 10 bits, so many times as bright."""
    primaries, transfer, matrix, red, blue = CODES[kind]
    signal = np.kron(patches() / 255, np.ones((16, 16, 1)))
    if kind != "BT.709":
        linear = np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4) * times_white
        to_bt2020 = [[0.627404, 0.329283, 0.043313], [0.069097, 0.919540, 0.011362], [0.016391, 0.088013, 0.895595]]
        light = linear @ np.transpose(to_bt2020)
        if kind == "HLG":
            scene = light * 0.26496
            above = 0.17883277 * np.log(np.maximum(12 * scene - 0.28466892, 1e-9)) + 0.55991073
            signal = np.where(scene <= 1 / 12, np.sqrt(3 * scene), above)
        elif kind == "PQ":
            power = (light * 203 / 10000) ** 0.1593017578125
            signal = ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375
        else:
            signal = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    luma = signal @ [red, 1 - red - blue, blue]
    chroma = [(signal[..., 2] - luma) / (2 - 2 * blue), (signal[..., 0] - luma) / (2 - 2 * red)]
    scales = (1023, 0, 1023) if is_full else (876, 64, 896)
    planes = [luma * scales[0] + scales[1], *(plane * scales[2] + 512 for plane in chroma)]
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx265", rate=30)
        codes = f"colorprim={primaries}:transfer={transfer}:colormatrix={matrix}"
        tags = f"{codes}:range={'full' if is_full else 'limited'}"
        stream.options = {"crf": "1", "x265-params": f"log-level=error:{tags}"}
        stream.height, stream.width, stream.pix_fmt = *luma.shape, "yuv444p10le"
        context = stream.codec_context
        context.color_primaries, context.color_trc, context.colorspace = primaries, transfer, matrix
        context.color_range = 2 if is_full else 1
        for n in range(5):
            frame = av.VideoFrame(luma.shape[1], luma.shape[0], "yuv444p10le")
            for plane, values in zip(frame.planes, planes, strict=True):
                rows = np.zeros((plane.height, plane.line_size // 2), np.uint16)
                rows[:, : values.shape[1]] = np.rint(values).clip(0, 1023)
                plane.update(rows.tobytes())
            frame.pts, frame.time_base, frame.colorspace, frame.color_range = n, Fraction(1, 30), matrix, 1 + is_full
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def shown(path: Path) -> NDArray:
    """(8, 8, 3) int of the patches of a video's second frame, read in passing as well as alone."""
    video = open_video(path)
    ((_, passing),) = video.frames([1])
    np.testing.assert_array_equal(passing, video.frame(1))
    return passing[8::16, 8::16].astype(int)


@pytest.mark.parametrize(("kind", "is_full"), [(kind, is_full) for kind in CODES for is_full in (False, True)])
def test_hdr_and_wide_gamuts_become_the_srgb_of_their_sdr_twins(tmp_path: Path, kind: str, is_full: bool) -> None:
    write_patches(tmp_path / "clip.mov", kind, is_full=is_full)
    np.testing.assert_allclose(shown(tmp_path / "clip.mov"), patches(), atol=3)


@pytest.mark.parametrize("kind", ["HLG", "PQ"])
def test_what_is_brighter_than_white_rolls_off(tmp_path: Path, kind: str) -> None:
    write_patches(tmp_path / "clip.mov", kind, times_white=2.5)
    greys = shown(tmp_path / "clip.mov")[0]
    assert (np.diff(greys, axis=0) >= 0).all() and greys[4].max() < 255 and greys[-1].min() >= 254
    assert (np.ptp(greys, axis=1) <= 2).all()


def test_the_largest_of_several_videos_is_read(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "two.mkv"), "w") as container:
        streams: list[Any] = []
        for height, width in ((16, 32), (HEIGHT, WIDTH)):
            stream: Any = container.add_stream("libx264", rate=FPS)
            stream.height, stream.width, stream.pix_fmt = height, width, "yuv420p"
            streams.append(stream)
        for stream in streams:
            for _ in range(3):
                grey = np.full((stream.height, stream.width, 3), 30 if stream is streams[0] else 200, np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(grey)))
            container.mux(stream.encode(None))
    video = open_video(tmp_path / "two.mkv")
    assert (len(video.stamps), video.height, video.width) == (3, HEIGHT, WIDTH)
    assert video.frame(2).mean() > 190


def write_frames(path: Path, frames: list[NDArray], **options: str) -> Path:
    """A clip of frames (H, W, 3) uint8 with one key frame."""
    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as container:
        stream: Any = container.add_stream("libx264", rate=FPS, options={"crf": "4", "g": "1000", **options})
        stream.height, stream.width, stream.pix_fmt = *frames[0].shape[:2], "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame)))
        container.mux(stream.encode(None))
    return path


NOISE = [np.kron(np.random.default_rng(i).integers(0, 256, (12, 12, 1)), np.ones((8, 8, 3))) for i in range(30)]
"""Frames that have nothing in common, of 96×96 pixels."""


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "ts"])
@pytest.mark.parametrize(("shape", "size"), [("4/3", (96, 128)), ("1/2", (192, 96))])
def test_pixels_that_are_not_square_are_shown_square(tmp_path: Path, ending: str, shape: str, size: tuple) -> None:
    ramp = np.tile(np.linspace(0, 255, 96).astype(np.uint8)[None, :, None], (96, 1, 3))
    video = open_video(write_frames(tmp_path / f"v.{ending}", [ramp] * 4, aspect=shape))
    assert (video.height, video.width) == size and video.stored == (96, 96)
    image = video.frame(1)
    assert image.shape[:2] == size and abs(image[size[0] // 2, size[1] // 2].mean() - 128) < 6
    assert video.frame(1, is_square=False).shape[:2] == (96, 96)


def test_cameras_of_frames_as_stored_are_taken(tmp_path: Path) -> None:
    """FFmpeg writes frames without regard to the shape of their pixels, and trackers state cameras of these."""
    clip = write_frames(tmp_path / "v.mp4", [np.full((HEIGHT, WIDTH, 3), 99, np.uint8)] * 4, aspect="4/3")
    scene = video_scene(clip, write_cameras(tmp_path, {"0.png": CAMERAS[0], "1.png": CAMERAS[1]}))
    assert scene.images().shape == (2, HEIGHT, WIDTH, 3)


@pytest.mark.parametrize("turns", range(8))
def test_frames_are_turned_and_mirrored_as_players_show_them(clip: Path, tmp_path: Path, turns: int) -> None:
    corner = np.zeros((64, 96, 3), np.uint8)
    corner[:32, :48] = 255
    data = bytearray(write_frames(tmp_path / "v.mp4", [corner] * 2).read_bytes())
    xx, xy, yx, yy = [(1, 0, 0, 1), (-1, 0, 0, 1), (1, 0, 0, -1), (-1, 0, 0, -1),
                      (0, 1, 1, 0), (0, 1, -1, 0), (0, -1, 1, 0), (0, -1, -1, 0)][turns]  # fmt: skip
    at = data.index(b"tkhd") + 44
    data[at : at + 36] = struct.pack(">9i", xx << 16, xy << 16, 0, yx << 16, yy << 16, 0, 0, 0, 1 << 30)
    (tmp_path / "turned.mp4").write_bytes(data)
    image = open_video(tmp_path / "turned.mp4").frame(0)
    x, y = -xx - yx, -xy - yy  # from the middle, where the white corner is shown
    height, width = image.shape[:2]
    assert (height, width) == ((64, 96) if xx else (96, 64))
    assert image[height // 2 + y * height // 4, width // 2 + x * width // 4].min() > 200
    assert image[height // 2 - y * height // 4, width // 2 - x * width // 4].max() < 50


def test_one_field_of_interlaced_frames_is_shown(tmp_path: Path) -> None:
    columns = [((np.arange(96) + shift) // 16 % 2 * 255).astype(np.uint8) for shift in (0, 8)]
    frame = np.stack([np.repeat(columns[row % 2][:, None], 3, axis=1) for row in range(96)])
    tags = {"x264-params": "tff=1:interlaced=1"}
    video = open_video(write_frames(tmp_path / "two.mp4", [frame] * 3, **tags))
    np.testing.assert_allclose(video.frame(1).mean(axis=(0, 2)), columns[0], atol=30)
    still = np.repeat(NOISE[0], 1, axis=0).astype(np.uint8)  # of one time, which is told from two by its lines
    progressive, tagged = (open_video(write_frames(tmp_path / f"{len(t)}.mp4", [still] * 3, **t)) for t in ({}, tags))
    np.testing.assert_allclose(tagged.frame(1).astype(int), progressive.frame(1), atol=12)


@pytest.mark.parametrize("is_flagged", [True, False])
@pytest.mark.parametrize(("times", "packing", "words"), [((1, 2, 1), 3, "side by side"), ((2, 1, 1), 4, "above")])
def test_two_pictures_in_one_are_refused_by_name(
    tmp_path: Path, times: tuple[int, ...], packing: int, words: str, is_flagged: bool
) -> None:
    blobs = np.kron(np.random.default_rng(0).uniform(0, 255, (16, 20, 3)), np.ones((10, 10, 1)))
    frames = [np.tile(np.roll(blobs, 3 * n, axis=1), times).astype(np.uint8) for n in range(3)]
    options = {"x264-params": f"frame-packing={packing}"} if is_flagged else {}
    with refusing(InputError, words):
        open_video(write_frames(tmp_path / "v.mp4", frames, **options))


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_a_clip_that_is_cut_short_says_so(tmp_path: Path, ending: str) -> None:
    path = write_frames(tmp_path / f"v.{ending}", [frame.astype(np.uint8) for frame in NOISE])
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    with pytest.warns(InputWarning, match=r"cut short: \d+ (of 30 )?frames are there, 0\.\d of 1\.2 s"):
        video = open_video(path)
    assert 10 < len(video.stamps) < 24 and video.frame(0).shape == (96, 96, 3)
    with refusing(InputError, f"29 of 0 to {len(video.stamps) - 1}"):
        video.frame(29)


def test_a_clip_without_its_index_says_why(tmp_path: Path) -> None:
    path = write_frames(tmp_path / "v.mov", [frame.astype(np.uint8) for frame in NOISE])
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 9 // 10])
    with refusing(InputError, "moov"):
        open_video(path)


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_damaged_frames_are_left_out_and_counted(tmp_path: Path, ending: str) -> None:
    frames = [frame.astype(np.uint8) for frame in NOISE]
    path = write_frames(tmp_path / f"v.{ending}", frames, g="10", bf="0")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 40] = bytes(40)  # of one of thirty frames, about the fifteenth
    path.write_bytes(data)
    video = open_video(path)
    with pytest.warns(InputWarning, match=r"\d+ of \d+ frames are damaged and left out"):
        left = dict(video.frames(range(30)))
    assert 15 <= len(left) < 30 and {0, 9, 20, 29} <= left.keys()
    for index, image in left.items():
        assert np.abs(image.astype(int) - frames[index]).mean() < 12
    with refusing(InputError, "damaged"):
        for index in set(range(30)) - left.keys():
            video.frame(index)
