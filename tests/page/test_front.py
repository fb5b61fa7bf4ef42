"""A page begins where most of the scene is in sight."""

import numpy as np
from page.scripts import close, run
from scipy.spatial.transform import Rotation

import tinysplat_runtime as ts
from tinysplat_runtime.page.front import front_of, front_view
from tinysplat_runtime.scene.cameras import Camera


def camera_at(x: float, focal: float = 60.0) -> Camera:
    K = np.array([[focal, 0, 32], [0, focal, 24], [0, 0, 1.0]])
    c2w = np.eye(4)
    c2w[0, 3] = x
    return Camera(K, c2w, 64, 48)


def test_the_middle_of_a_row_is_in_front() -> None:
    cameras = [camera_at(x) for x in (-0.8, -0.4, 0.0, 0.4, 0.8)]
    assert front_view(cameras) == 2
    assert front_view(cameras[:1]) == front_view([]) == 0


def test_about_an_object_that_all_photos_show_the_middle_of_the_way_is_in_front() -> None:
    K = np.array([[60, 0, 32], [0, 60, 24], [0, 0, 1.0]])
    cameras = []
    for degrees in range(-80, 81, 20):
        c2w = np.eye(4)
        c2w[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        c2w[:3, 3] = -4 * c2w[:3, 2]
        cameras.append(Camera(K, c2w, 64, 48))
    assert front_view(cameras) == 4


START = 'import { frontView, sideOf } from "./front.js"; import { viewOf } from "./scene.js";'


def described(camera: Camera) -> dict[str, object]:
    (fx, skew, cx), (_, fy, cy), _ = camera.K.tolist()
    lens = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew}
    return {"width": camera.width, "height": camera.height, **lens, "c2w": camera.c2w.ravel().tolist()}


def test_the_player_begins_where_a_page_of_the_same_file_does() -> None:
    rng = np.random.default_rng(3)
    K = np.array([[60, 0, 32], [0, 60, 24], [0, 0, 1.0]])
    for count in (2, 5, 12):
        cameras = []
        for turn in rng.normal(scale=0.4, size=(count, 3)):
            c2w = np.eye(4)
            c2w[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
            c2w[:3, 3] = c2w[:3, 2] * -4 + rng.normal(scale=0.3, size=3)
            cameras.append(Camera(K, c2w, 64, 48))
        code = "return frontView(CAMERAS.map(viewOf));"
        assert run(code, START, CAMERAS=[described(camera) for camera in cameras]) == front_view(cameras)


def test_an_object_is_seen_from_the_side_that_shows_most() -> None:
    rng = np.random.default_rng(4)
    for turn in (0.3, 1.2, 2.4):  # a plate with a picture on one of its faces
        means = np.stack([*rng.uniform([-1, -1], [1, 1], (4000, 2)).T, np.repeat([-0.05, 0.05], 2000)], axis=1)
        sh = np.zeros((4000, 1, 3))
        sh[:2000] = rng.normal(size=(2000, 1, 1))
        rotation = Rotation.from_rotvec([0, turn, 0]).as_matrix()
        gaussians = ts.Gaussians(
            np.float32(means @ rotation.T),
            np.tile(np.float32([1, 0, 0, 0]), (4000, 1)),
            np.full((4000, 3), 0.02, np.float32),
            np.ones(4000, np.float32),
            np.float32(sh),
            origin=np.array([5.0, 6.0, 7.0]),
        )
        camera = front_of(gaussians)
        assert camera.rotation[2] @ rotation[:, 2] > 0.9
        pixels = (means @ rotation.T + gaussians.origin - camera.centre) @ camera.rotation.T @ camera.K.T
        assert (np.abs(pixels[:, :2] / pixels[:, 2:] / camera.width - 0.5) < 0.5).all()
        arrays = {name: getattr(gaussians, name).ravel().tolist() for name in ("means", "opacities", "sh")}
        found = run("return sideOf({ ...SCENE, degree: 0, count: 4000, origin: [5, 6, 7] });", START, SCENE=arrays)
        close(found["position"], camera.centre, 1e-4)
        close(found["rotation"], camera.rotation, 1e-6)
