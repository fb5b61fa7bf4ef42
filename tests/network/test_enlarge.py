"""Large photos: where surfaces and their edges come to lie, that tiles have no seams, and who takes that way."""

from dataclasses import replace

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, SQUARE_Z, WALL_Z, TracedScene, trace

from tinysplat_runtime.errors import ModelError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.graphs import DEFAULT_MODEL
from tinysplat_runtime.graphs.inference import Graph, GraphStore
from tinysplat_runtime.network.enlarge import Enlarger, predict_large
from tinysplat_runtime.scene.cameras import Camera

STORE = GraphStore()
OPACITY, FOOTPRINT = 0.6, 0.45


class ExactSession:
    """Stands in for a network: the traced scene's own surfaces at any size, its colours brighter by a tint."""

    def __init__(self, scene: TracedScene, tint: float = 0.0) -> None:
        self.scene, self.tint = scene, tint
        self.size = (0, 0)

    def run(self, names: list[str], inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        images, c2w = inputs["images"], inputs["c2w"].astype(np.float64)
        views, _, height, width = images.shape
        self.size = (height, width)
        rows, columns = (
            (np.arange(n) * full // n + full // (2 * n)).astype(int)
            for n, full in zip((height, width), self.scene.depth.shape[1:], strict=True)
        )
        depth = self.scene.depth[:, rows][:, :, columns]
        K = inputs["K"].astype(np.float64) * [[width], [height], [1]]
        y, x = np.mgrid[:height, :width] + 0.5
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K).transpose(0, 2, 1)[:, None]
        focal = np.sqrt(K[:, 0, 0] * K[:, 1, 1])[:, None, None, None]
        means = np.einsum("vij,vhwj->vhwi", c2w[:, :3, :3], rays * depth[..., None]) + c2w[:, None, None, :3, 3]
        colours = images.transpose(0, 2, 3, 1)[:, :, :, None] + self.tint
        arrays = {
            "means": means,
            "quats": np.broadcast_to([1.0, 0, 0, 0], (views, height, width, 4)),
            "scales": np.broadcast_to(FOOTPRINT * depth[..., None] / focal, (views, height, width, 3)),
            "opacities": np.full((views, height, width), OPACITY),
            "sh": (colours - 0.5) / C0,
        }
        return [np.float32(arrays[name]) for name in names]


def exact_graph(scene: TracedScene, tint: float = 0.0) -> tuple[Graph, ExactSession]:
    session = ExactSession(scene, tint)
    metadata = {"min_views": 2, "max_views": 6, "stride": 4, "min_side": 8}
    return Graph("exact", session, metadata, ("means", "quats", "scales", "opacities", "sh")), session


def enlarger(pixels: int, **changes: int) -> Enlarger:
    graph = STORE.enlarger()
    assert graph is not None
    return replace(Enlarger.of(graph), pixels=pixels, **changes)


@pytest.fixture(scope="module")
def scene() -> TracedScene:
    return trace(3, 120, 150)


def enlarged(scene: TracedScene, tint: float = 0.0, **changes: int) -> Gaussians:
    graph, _ = exact_graph(scene, tint)
    return predict_large(scene.images, scene.cameras, NEAR, FAR, graph, enlarger(48 * 60, **changes))


def depths(gaussians: Gaussians) -> np.ndarray:
    """z of every Gaussian before its camera, and where it lies in the picture, against the pixel's centre."""
    found = []
    for view, camera in enumerate(gaussians.cameras):
        points = (gaussians.means[view] + gaussians.origin - camera.centre) @ camera.rotation.T
        pixels = points @ camera.K.T / points[..., 2:]
        row, column = np.mgrid[: camera.height, : camera.width] + 0.5
        np.testing.assert_allclose(pixels[..., 0], column, atol=2e-3)
        np.testing.assert_allclose(pixels[..., 1], row, atol=2e-3)
        found.append(points[..., 2])
    return np.stack(found)


@pytest.mark.parametrize("place", [(0, 0, 0), (4e3, -2e3, 5e3)], ids=["here", "far from the origin"])
def test_surfaces_and_their_edges_lie_where_the_large_photos_have_them(scene: TracedScene, place: tuple) -> None:
    ways = [c.c2w + np.pad(np.array(place, float)[:, None], ((0, 1), (3, 0))) for c in scene.cameras]
    cameras = tuple(Camera(c.K, c2w, c.width, c.height) for c, c2w in zip(scene.cameras, ways, strict=True))
    gaussians = enlarged(replace(scene, cameras=cameras))
    assert gaussians.cameras == cameras
    found = depths(gaussians)
    error = np.abs(found / scene.depth - 1)
    assert np.median(error) < 1e-2
    # A small pixel is 2.5 large ones: by its place alone more than a pixel at each edge belongs to the other surface.
    boundary = (WALL_Z + SQUARE_Z) / 2
    nearest = found < boundary
    wrong = nearest != (scene.depth < boundary)
    edge = np.abs(np.diff((scene.depth < boundary).astype(int), axis=2)).sum()
    assert wrong.sum() < edge
    np.testing.assert_allclose(gaussians.opacities, OPACITY, atol=1e-3)
    frontal = gaussians.scales[0, :, :, 2] * gaussians.cameras[0].focal / found[0]
    np.testing.assert_allclose(frontal, FOOTPRINT, rtol=5e-2)


def test_tiles_have_no_seams(scene: TracedScene) -> None:
    whole, tiles = enlarged(scene), enlarged(scene, tile=40)  # 3 × 4 of them, of unlike sizes
    for name in ("means", "quats", "scales", "opacities", "sh"):
        a, b = getattr(whole, name), getattr(tiles, name)
        error = np.abs(a - b) / np.abs(a).max()
        # Of two Gaussians at one depth rounding decides which hides the other, and with it how much is sharpened.
        assert error.max() <= (1e-4 if name != "sh" else 8e-4), name
        assert np.quantile(error, 0.995) <= 1e-4, name


def test_refusals(scene: TracedScene) -> None:
    graph, _ = exact_graph(scene)
    shipped = STORE.enlarger()
    assert shipped is not None and DEFAULT_MODEL in Enlarger.of(shipped).networks
    for damaged in (graph, replace(shipped, metadata={**shipped.metadata, "pixels": 0})):
        with pytest.raises(ModelError) as caught:
            Enlarger.of(damaged)
        assert caught.value.where == damaged.name
