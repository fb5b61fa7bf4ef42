"""The stream of training samples: sample i is a function of the seed and i, whatever thread makes it and when."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE

from .config import DataSettings
from .photos import PhotoSet
from .procedural import procedural_sample
from .samples import Sample
from .textures import texture_bank

_BANK = 2**32
"""Index of the generator of the texture bank, beyond any sample."""

_AHEAD = 6
"""Samples made in advance."""


class SampleStream:
    """Real and procedural samples by index.

    Args:
        settings: what to draw from.

    Raises:
        InputError: the folder of photos holds nothing to train on, or that of pictures no picture.
    """

    def __init__(self, settings: DataSettings) -> None:
        self.settings = settings
        folder = Path(settings.photos)
        self.photos = PhotoSet.load(folder)
        scenes = sorted(path.parent for path in folder.glob(f"*/{CAMERAS_FILE}"))
        pictures = Path(settings.pictures) if settings.pictures else None
        self.textures = texture_bank(scenes, settings.textures, self._generator(_BANK), pictures)

    def _generator(self, index: int) -> np.random.Generator:
        return np.random.default_rng([self.settings.seed, index])

    def sample(self, index: int) -> Sample:
        """Sample number `index`."""
        s, rng = self.settings, self._generator(index)
        side = s.large_side if rng.random() < s.large_share else s.side
        if rng.random() < s.photo_share:
            return self.photos.sample(rng, side, s.targets)
        views = 3 if rng.random() < s.many_views_share else 2
        return procedural_sample(rng, self.textures, side, views, s.targets)

    def follow(self, start: int) -> Iterator[Sample]:
        """Samples from number `start` on without end, made ahead by one thread."""
        ready: queue.Queue[Sample | BaseException] = queue.Queue(_AHEAD)

        def work() -> None:
            index = start
            try:
                while True:
                    ready.put(self.sample(index))
                    index += 1
            except BaseException as error:  # handed to the thread that waits for the sample
                ready.put(error)

        threading.Thread(target=work, daemon=True).start()
        while True:
            sample = ready.get()
            if isinstance(sample, BaseException):
                raise sample
            yield sample
