"""The whole chain: photos to Gaussians to a file to Gaussians to one picture, as one call."""

from __future__ import annotations

from collections.abc import Sequence

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.graphs.predict import predict

from .inputs import Photos, PhotoSource
from .judge import photo_figures
from .timing import Figures, Row, Setting, Stage, Variant


def chain_stage(
    source: PhotoSource,
    models: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    codings: Sequence[tuple[str, float]],
    judged_at: tuple[int, int],
    runtime: Runtime,
) -> tuple[Stage, list[Row]]:
    """Every network at every size with every (profile, Q_g), judged at the targets, or at the inputs without any."""
    targets = source.targets(*judged_at)
    judged = targets if targets.cameras else source.context(*judged_at)
    variants, failed = [], []
    for model in models:
        for height, width in sizes:
            photos = source.context(height, width)
            for profile, qp in codings:
                label = f"{model} at {height}×{width}, {profile} qp {qp:g}"
                run = _Chain(source.depth_range, model, photos, profile, qp, judged, runtime)
                try:
                    run()
                except TinySplatError as error:
                    failed.append(Row("chain", source.name, label, runtime.threads, note=str(error)))
                    continue
                settings: dict[str, Setting] = {
                    "model": model,
                    "height": height,
                    "width": width,
                    "profile": profile,
                    "qp": qp,
                }
                variants.append(Variant(label, run, run.figures, settings, runtime.threads))
    return Stage("chain", source.name, variants), failed


class _Chain:
    """One way through the chain, ready to be called."""

    def __init__(
        self,
        depth_range: tuple[float, float],
        model: str,
        photos: Photos,
        profile: str,
        qp: float,
        judged: Photos,
        runtime: Runtime,
    ) -> None:
        self._depth_range, self._photos, self._judged = depth_range, photos, judged
        self._graph, self._profile, self._qp = runtime.store.network(model), profile, qp
        self._runtime = runtime

    def __call__(self) -> bytes:
        """Photos to a picture; returns the file on the way."""
        near, far = self._depth_range
        gaussians = predict(self._photos.images, self._photos.cameras, near, far, self._graph)
        data = self._runtime.compress(gaussians, self._profile, self._qp, drop_invalid=True)
        self._runtime.render(self._runtime.decompress(data), self._judged.cameras[0])
        return data

    def figures(self, data: bytes) -> Figures:
        """`bytes`, and `psnr` against the photos."""
        decoded = self._runtime.decompress(data)
        images = list(self._judged.images)
        return {"bytes": len(data), **photo_figures(decoded, self._judged.cameras, images, self._runtime.threads)}
