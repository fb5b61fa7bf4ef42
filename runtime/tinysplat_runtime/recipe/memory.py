"""Whether photos fit in the memory that is free, and captures on the disk, before a network runs."""

from collections.abc import Callable

from ..errors import InputError
from ..network.enlarge import LARGE_PIXELS
from ..network.ways import OneByOne, SmallCopies, Way
from ..scene.neighbours import GROUP
from ..scene.scenes import Scene
from ..scene.viewchoice import ALL_VIEWS
from ..system.disk import HELD_BYTES, room
from ..system.memory import available_bytes

BYTES_AT_ALL = 250_000_000
"""Memory that libraries and graphs take, whatever the photos."""

NETWORK_BYTES = (350, -240)
"""What a network takes besides, per pixel of all photos: so much for each view, and this. `edge` as measured at 512×512
with 2 views 335, 4 views 1,124 and 6 views 1,807, at 1024×1024 with 2 views 478; `sweep` 510 with 2."""

EACH_BYTES_PER_PIXEL, KEPT_BYTES_PER_PIXEL = 2200, 125
"""The same of a photo that goes through the network beside its partners, with what is kept of those about it, 2,145 as
measured at 415×738; and what is kept of every pixel of all photos: photos, and Gaussians where there is no disk."""

CAPTURE_BYTES_PER_PIXEL = 150
"""What a capture takes of every pixel of its photos where there is no disk: Gaussians, and planes while they are
coded."""

DISK_BYTES_PER_PIXEL, ASIDE_BYTES_PER_PIXEL = 260, 5
"""What it takes of the disk, and of memory then: cells of photos, and numbers of blocks."""

TRAINED_BYTES_PER_PIXEL = 60
"""What training a list takes of every pixel of its photos, beside the capture's Gaussians; as measured on 24 photos of
256×256 51, of 640×480 24, without a disk 28."""

LARGE_BYTES_PER_PIXEL = 147
"""The same of large photos, whose small copies alone a network is given: photos and Gaussians 77 while these are made,
Gaussians and planes 120 while they are coded; as measured on two photos of 12 megapixels."""

PHOTO_BYTES_PER_PIXEL = 12
"""Of photos while a network runs on their small copies."""

MEMORY_SHARE = 0.9
"""Of the memory that is free, at most so much is planned with."""


def check_memory(
    scene: Scene, way: Way | None = None, *, is_coded: bool = True, trained_on: Scene | None = None
) -> None:
    """Refuse photos that take more memory than is free, with a size that would fit.

    Args:
        scene: the photos, as a network has them.
        way: how they go through the network; None for group by group.
        is_coded: whether Gaussians are, and not the photos themselves.
        trained_on: the same photos as a list is trained on them; None where none is.
    """
    each, enlarger = isinstance(way, OneByOne), way.enlarger if isinstance(way, SmallCopies) else None
    disk = room() / DISK_BYTES_PER_PIXEL if is_coded else 0  # in pixels
    camera, free, views = (trained_on or scene).frames[0].camera, available_bytes(), len(scene.frames)
    most_seen = views * scene.frames[0].camera.width * scene.frames[0].camera.height

    def needed(pixels: float) -> float:
        """Bytes that so many pixels of all photos take."""
        seen = min(pixels, most_seen)  # by the network
        together = views if views in ALL_VIEWS else GROUP
        grouped = (NETWORK_BYTES[0] * together + NETWORK_BYTES[1]) * together
        network = EACH_BYTES_PER_PIXEL if each else grouped
        aside = ASIDE_BYTES_PER_PIXEL if seen <= disk else None
        taken = [0.0]
        if enlarger is None or seen <= views * LARGE_PIXELS:
            taken.append(network * seen / views + ((aside or KEPT_BYTES_PER_PIXEL) * seen if each else 0))
        else:
            taken.append(network * enlarger.pixels + PHOTO_BYTES_PER_PIXEL * seen)
            taken.append(LARGE_BYTES_PER_PIXEL * seen)
        if together < views:
            taken.append((aside or CAPTURE_BYTES_PER_PIXEL) * seen)
        if trained_on:
            taken.append(HELD_BYTES + (aside or CAPTURE_BYTES_PER_PIXEL) * seen + TRAINED_BYTES_PER_PIXEL * pixels)
        return BYTES_AT_ALL + max(taken)

    pixels = views * camera.width * camera.height
    if free is None or needed(pixels) <= MEMORY_SHARE * free:
        return
    share = (_largest(needed, pixels, MEMORY_SHARE * free) / pixels) ** 0.5
    size = f"{int(camera.width * share)}x{int(camera.height * share)}"
    fault = f"{views} photos of {camera.width}x{camera.height} take about {needed(pixels) / 1e9:.1f} GB"
    advice = f"--size {size} would fit" if share * min(camera.height, camera.width) >= 64 else "free some first"
    raise InputError(f"{fault}, {free / 1e9:.1f} GB are free; {advice}", where=str(scene.path))


def _largest(needed: Callable[[float], float], most: float, free: float) -> float:
    """How many pixels, of `most`, take no more than is free."""
    low, high = 0.0, float(most)
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if needed(middle) <= free else (low, middle)
    return low
