"""The stream of training samples: sample i is a function of the seed and i, whatever thread makes it and when."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from .config import DataSettings
from .photos import PhotoSet, scene_folders
from .procedural import procedural_sample
from .samples import Sample
from .textures import texture_bank

_BANK = 2**32
"""Index of the generator of the texture bank, beyond any sample."""

MOST = 320
"""Side of the largest target of a procedural sample, pixels."""

_AHEAD = 6
"""Samples made in advance by each thread."""


class SampleStream:
    """Real and procedural samples by index.

    Args:
        settings: what to draw from.

    Raises:
        InputError: the folder of photos holds nothing to train on, or that of pictures no picture.
    """

    def __init__(self, settings: DataSettings) -> None:
        self.settings = settings
        self.photos, scenes = PhotoSet((), ()), []
        if settings.photos:
            self.photos = PhotoSet.load(Path(settings.photos))
            scenes = scene_folders(Path(settings.photos))
        pictures = Path(settings.pictures) if settings.pictures else None
        self.textures = texture_bank(scenes, settings.textures, self._generator(_BANK), pictures)

    def _generator(self, index: int) -> np.random.Generator:
        return np.random.default_rng([self.settings.seed, index])

    def sample(self, index: int) -> Sample:
        """Sample number `index`."""
        s, rng = self.settings, self._generator(index)
        side = s.large_side if rng.random() < s.large_share else s.side
        views = int(rng.integers(3, 5)) if rng.random() < s.many_views_share else 2
        targets = [round(zoom * side) for zoom in rng.choice(s.zooms, s.targets)]
        if rng.random() < s.photo_share and self.photos.scenes:
            return self.photos.sample(rng, side, views, targets)
        return procedural_sample(rng, self.textures, side, views, [min(target, MOST) for target in targets])

    def follow(self, start: int) -> Iterator[Sample]:
        """Samples from number `start` on without end, in order, made ahead by threads."""
        with ThreadPoolExecutor(self.settings.workers) as pool:
            ahead: deque[Future[Sample]] = deque()
            index = start
            try:
                while True:
                    while len(ahead) < _AHEAD * self.settings.workers:
                        ahead.append(pool.submit(self.sample, index))
                        index += 1
                    yield ahead.popleft().result()
            finally:
                for future in ahead:
                    future.cancel()
