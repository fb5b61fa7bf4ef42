"""360° pictures: faces show what they should, files say what they are, and their places are found as they were."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from console import fail, succeed
from numpy.typing import NDArray
from poses.walls import textured
from scenes import refusing, tells

from tinysplat.poses.panoramas import Wedge, check_shape, face, kept, places, rays, says_panorama, side_of
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render.panorama import FACES, panorama, panorama_png
from tinysplat_runtime.scene.cameras import Camera, posed
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.pictures import jpeg_bytes, write_png

HEIGHT, PLACES = 240, 4
LOW, HIGH = np.array([-3.0, -1.5, -4.0]), np.array([3.0, 1.5, 4.0])  # of a room
BOX = np.array([-1.6, 0.2, 1.0]), np.array([-0.6, 1.5, 2.0])  # and of what stands in it


def directions(height: int) -> NDArray:
    """(H, 2H, 3) of the pixels of an equirectangular picture, by its definition."""
    row, column = np.mgrid[:height, : 2 * height] + 0.5
    longitude, latitude = np.pi * (column / height - 1), np.pi * (0.5 - row / height)
    level = np.cos(latitude)
    return np.stack([level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)], axis=-1)


def seen(centre: NDArray, rays: NDArray) -> NDArray:
    """(…, 3) colours of a textured room and a box in it, from inside."""
    flat = rays.reshape(-1, 3)
    nearest, colours = np.full(len(flat), np.inf), np.zeros(flat.shape)
    for low, high, first in ((LOW, HIGH, 0), (*BOX, 3)):
        for axis in range(3):
            others = [other for other in range(3) if other != axis]
            for side, bound in enumerate((low[axis], high[axis])):
                with np.errstate(divide="ignore", invalid="ignore"):
                    away = (bound - centre[axis]) / flat[:, axis]
                    points = centre + flat * away[:, None]
                    inside = ((points[:, others] >= low[others]) & (points[:, others] <= high[others])).all(axis=1)
                    hit = (away > 1e-6) & (away < nearest) & inside
                u, v = ((points[hit][:, other] * 90 + 300) % 599 for other in others)
                texture = TEXTURES[(first + 2 * axis + side) % len(TEXTURES)]
                colours[hit], nearest[hit] = texture[u.astype(int), v.astype(int)], away[hit]
    return colours.reshape(rays.shape)


TEXTURES = [textured(seed) / 255 for seed in range(5)]


def way() -> list[tuple[NDArray, NDArray]]:
    """Centres (3,) and turns (3, 3) to the world of pictures on a way through the room."""
    found = []
    for step in np.linspace(0, 1, PLACES):
        angle = 0.4 * np.sin(3 * step)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        found.append((np.array([2 * step - 1, 0.1 * np.sin(5 * step), 1.6 * step**2 - 0.8]), turn))
    return found


@pytest.fixture(scope="module")
def pictures() -> list[NDArray]:
    ahead = directions(HEIGHT)
    return [np.rint(255 * seen(centre, ahead @ turn.T)).astype(np.uint8) for centre, turn in way()]


@pytest.mark.parametrize("name", FACES)
def test_a_face_shows_what_a_camera_there_would(name: str) -> None:
    """Colours that are a smooth function of direction, poles and the seam behind among them."""

    def colour(ahead: NDArray) -> NDArray:
        unit = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        return 127.5 + 60 * np.stack([unit[..., 0] * unit[..., 1], unit[..., 1], unit[..., 2] + unit[..., 0]], axis=-1)

    side = side_of(256)
    shown = face(np.rint(colour(directions(256))).astype(np.uint8), name, side)
    camera = Camera([[side / 2, 0, side / 2], [0, side / 2, side / 2], [0, 0, 1]], np.eye(4), side, side)
    row, column = np.mgrid[:side, :side] + 0.5
    own = np.stack([column, row, np.ones_like(row)], axis=-1) @ np.linalg.inv(camera.K).T @ FACES[name]
    assert np.abs(shown - colour(own)).max() < 1.5
    np.testing.assert_allclose(rays(side) @ FACES[name], own, atol=1e-12)
    x, y = np.moveaxis(places(own, 256), -1, 0)
    longitude, latitude = np.pi * (x / 256 - 1), np.pi * (0.5 - y / 256)
    back = np.stack([np.cos(latitude) * np.sin(longitude), -np.sin(latitude), np.cos(latitude) * np.cos(longitude)], -1)
    np.testing.assert_allclose(back, own / np.linalg.norm(own, axis=-1, keepdims=True), atol=1e-12)
    np.testing.assert_allclose(FACES[name] @ FACES[name].T, np.eye(3))
    assert np.linalg.det(FACES[name]) > 0


def test_a_panorama_shows_all_that_a_camera_there_would() -> None:
    def colour(ahead: NDArray) -> NDArray:
        unit = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
        return 0.5 + 0.24 * np.stack([unit[..., 0] * unit[..., 1], unit[..., 1], unit[..., 2] + unit[..., 0]], axis=-1)

    def draw(camera: Camera) -> NDArray:
        row, column = np.mgrid[: camera.height, : camera.width] + 0.5
        own = np.stack([column, row, np.ones_like(row)], axis=-1) @ np.linalg.inv(camera.K).T
        return colour(own @ camera.rotation)

    (centre, turn), down = way()[1], np.array([0.0, 3.0, 0.0])
    nod = np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])  # which a picture that stands upright does not have
    camera = Camera(np.eye(3), posed(turn @ nod, centre), 8, 8)
    for height in (2, 5, 64):
        shown = panorama(draw, camera, down, height)
        assert shown.shape == (height, 2 * height, 3)
        assert np.abs(shown - colour(directions(height) @ turn.T)).max() < (0.01 if height > 5 else 0.2)
    straight = panorama(draw, replace(camera, c2w=posed(FACES["down"].T, centre)), down, 16)
    assert np.abs(straight - colour(directions(16) @ FACES["down"])).max() < 0.05


def test_wedges_are_left_out_of_the_faces_that_show_them() -> None:
    behind = [Wedge(135, 225)]
    assert not kept("back", 32, behind).any() and all(
        kept(name, 32, behind).all() for name in ("front", "left", "right")
    )
    assert 0.2 < kept("down", 32, behind).mean() < 0.8
    assert not kept("front", 33, [Wedge(-10, 10)])[:, 16].any() and kept("front", 33, [Wedge(-10, 10)])[:, 0].all()


def box(kind: bytes, *inside: bytes) -> bytes:
    body = b"".join(inside)
    return struct.pack(">I4s", 8 + len(body), kind) + body


def test_files_say_that_they_are_360(tmp_path: Path) -> None:
    photo = jpeg_bytes(np.full((16, 32, 3), 90, np.uint8))
    xmp = b'http://ns.adobe.com/xap/1.0/\0<x GPano:ProjectionType="equirectangular"/>'
    sphere = box(b"sv3d", box(b"svhd", b"\0" * 5), box(b"proj", box(b"prhd", b"\0" * 16), box(b"equi", b"\0" * 20)))
    xml = b"<GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>"
    uuid = box(b"uuid", bytes.fromhex("ffcc8263f8554a938814587a02521fdd"), xml)
    written = {
        "plain.jpg": photo,
        "xmp.jpg": photo[:2] + struct.pack(">HH", 0xFFE1, 2 + len(xmp)) + xmp + photo[2:],
        "plain.mp4": box(b"ftyp", b"isom") + box(b"mdat", b"sv3d equi") + box(b"moov", b"\0" * 40),
        "sphere.mp4": box(b"ftyp", b"isom") + box(b"mdat", b"\0" * 99) + box(b"moov", box(b"trak", sphere)),
        "uuid.mp4": box(b"ftyp", b"isom") + box(b"moov", box(b"trak", uuid)),
        "cut.mp4": box(b"ftyp", b"isom") + struct.pack(">I4sQ", 1, b"mdat", 1 << 60),
        "still.mp4": box(b"ftyp", b"isom") + struct.pack(">I4s", 0, b"mdat") + b"\0" * 20,
        "empty.mp4": b"",
        "ours.png": panorama_png(np.full((16, 32, 3), 90, np.uint8)),
    }
    for name, data in written.items():
        (tmp_path / name).write_bytes(data)
    said = {name for name in written if says_panorama(tmp_path / name)}
    assert said == {"xmp.jpg", "sphere.mp4", "uuid.mp4", "ours.png"} and not says_panorama(tmp_path / "nowhere.jpg")


@pytest.mark.parametrize(("height", "width", "words"), [(100, 199, "199x100"), (100, 100, "100x100 stereo")])
def test_other_shapes_are_refused_by_name(tmp_path: Path, height: int, width: int, words: str) -> None:
    with refusing(InputError, f"a.png: {words}"):
        check_shape(height, width, "a.png")
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, np.full((height, width, 3), len(name), np.uint8))
    assert tells(fail("poses", "--360", tmp_path, "-o", tmp_path / "scene"), f"a.png: {words}")


@pytest.mark.parametrize("words", ["150", "210-150", "0-360", "nan-1", "sideways"])
def test_parts_that_there_are_not_are_refused(tmp_path: Path, words: str) -> None:
    assert words in fail("poses", tmp_path, "-o", tmp_path / "scene", "--360", "--without", words)


def write_photos(folder: Path, pictures: list[NDArray]) -> Path:
    (folder / "photos").mkdir()
    ahead = np.full((HEIGHT, 2 * HEIGHT), 255, np.uint8)
    ahead[:, HEIGHT // 4 : HEIGHT // 2 - 10] = 0  # within what shows to the left
    (folder / "masks").mkdir()
    for i, picture in enumerate(pictures):
        write_png(folder / f"photos/{i}.png", picture)
        write_png(folder / f"masks/{i}.png", ahead)
    return folder / "photos"


def write_clip(folder: Path, pictures: list[NDArray]) -> Path:
    with av.open(str(folder / "clip.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=5, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = 2 * HEIGHT, HEIGHT, "yuv420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(stream.encode(None))
    return folder / "clip.mp4"


@pytest.mark.parametrize("written", [write_photos, write_clip])
def test_places_are_found_within_a_hundredth(
    tmp_path: Path, pictures: list[NDArray], written: Callable[[Path, list[NDArray]], Path]
) -> None:
    source = written(tmp_path, pictures)
    succeed("poses", "--360", source, "-o", tmp_path / "scene", "-q", "--without", "down", "--without", "170-190")
    scene = load_scene(tmp_path / "scene", near=1, far=9)
    assert len(scene.frames) == 5 * PLACES
    faces = {name: [frame for frame in scene.frames if frame.path.name.startswith(name)] for name in FACES}
    back = faces["back"][0].known()
    assert back is not None and not back[:, back.shape[1] // 2].any() and faces["front"][0].known() is None
    assert (faces["left"][0].known() is None) == (written is write_clip)
    found = np.stack([frame.camera.centre for frame in faces["front"]])
    truth = np.stack([centre for centre, _ in way()])
    turn = way()[0][1] @ faces["front"][0].camera.rotation
    own, its = (found - found[0]) @ turn.T, truth - truth[0]
    own *= np.linalg.norm(its[-1]) / np.linalg.norm(own[-1])
    assert np.abs(own - its).max() < 0.01 * np.linalg.norm(its[-1])
    for name, frames in faces.items():
        for frame, (_, own_turn), centre in zip(frames, way(), found, strict=False):
            np.testing.assert_allclose(frame.camera.centre, centre, atol=1e-9)
            rotation = frame.camera.rotation @ turn.T
            apart = rotation @ own_turn @ FACES[name].T - np.eye(3)
            assert np.degrees(np.linalg.norm(apart)) / np.sqrt(2) < 0.5  # of small turns, the angle
