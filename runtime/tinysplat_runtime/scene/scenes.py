"""Scenes: photos of one place and the cameras that took them. Cameras are there at once, photos only when asked for.

`intake` reads scenes, whoever wrote them.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from numbers import Integral
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn
from ..system.printable import type_of
from ..system.told import NOBODY, Told
from . import BACKGROUND
from .cameras import Camera, check_depth, check_is_in_pixels
from .footage import Video
from .images import read_image
from .lenses import Lens
from .masks import Mask, filled
from .resampling import resize_cover

MAX_CAMERAS_BYTES = 64 * 1000 * 1000
"""A frame takes about 500 bytes, so this is more than 100,000 of them."""

LARGE_PHOTO = 1 << 20
"""Pixels of a photo from which on it is read as small as is enough for the picture that is wanted."""

KEPT_BYTES = 128 << 20
"""Of resized photos that a scene keeps, once read: reading one of 12 million pixels again takes half a second."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One photo and its camera.

    Attributes:
        camera: the view as `image` delivers it.
        path: the photo, or the video that it is a frame of.
        photo_camera: the view as the photo has it, where `camera` is resized from it; otherwise None.
        lens: the intrinsics that the photo was taken with, where its distortion is to be taken out first.
        video: the file at `path` looked through, where it is a video; otherwise None.
        index: which of the video's frames.
        taken_with: the intrinsics of the photo that the one at `path` was made from, where that is known: those of the
            video's frames whose photos they were.
        mask: which of the photo's pixels count, where not all do.
        number: which of its file's photos it is, counted from 0, whether they are there or not; None where unknown.
        is_stored: whether the photo is taken as it is stored, whatever its Exif orientation.
        kept: what `image` and `known` gave, by these names, once they did; None where that is not to be kept.
    """

    camera: Camera
    path: Path
    photo_camera: Camera | None = None
    lens: Lens | None = None
    video: Video | None = None
    index: int = 0
    taken_with: Lens | None = None
    mask: Mask | None = None
    number: int | None = None
    is_stored: bool = False
    kept: dict[str, NDArray | None] | None = field(default=None, repr=False)

    @classmethod
    def through(cls, lens: Lens, c2w: NDArray, path: Path, mask: Mask | None = None) -> Frame:
        """A photo that a lens took at pose (4, 4); errors of `Lens.camera`."""
        return cls(lens.camera(c2w), path, lens=None if lens.is_pinhole else lens, mask=mask)

    def resized(self, height: int, width: int, *, keep: bool = False) -> Frame:
        """The frame scaled to cover height × width and cropped around its centre; always from the whole photo."""
        photo_camera = self.photo_camera or self.camera
        camera = photo_camera.resized(height, width)
        return replace(self, camera=camera, photo_camera=photo_camera, kept={} if keep else None)

    def image(self, photo: NDArray | None = None) -> NDArray:
        """The photo: (H, W, 3) float32 in [0, 1], of the camera's size; read-only where it is kept.

        Pixels that do not count continue those beside them smoothly, so that they are like nothing in other photos.

        Args:
            photo: what `photo` gave, where that is at hand.

        Raises:
            InputError: see `photo` and `known`.
        """
        if self.kept and (kept := self.kept.get("image")) is not None:
            return kept
        size = self.camera.height, self.camera.width
        pixels = self.photo(None if self.photo_camera is None else size) if photo is None else photo
        if self.photo_camera is None:
            image = pixels.astype(np.float32) / np.float32(255)
        else:
            image = resize_cover(pixels, *size, (self.photo_camera.height, self.photo_camera.width))
        if (known := self.known()) is not None:
            image = filled(image, known)
        if self.kept is not None:
            image.flags.writeable = False
            self.kept["image"] = image
        return image

    def forget(self) -> None:
        """Let go of what is kept: whoever asks for it again has it read again."""
        if self.kept is not None:
            self.kept.clear()

    def known(self) -> NDArray | None:
        """Which of the pixels of `image` count: (H, W) bool; None where all do.

        Raises:
            InputError: names the mask, which cannot be read or is of another shape than the photo.
        """
        if self.mask is None:
            return None
        if self.kept is not None and "known" in self.kept:
            return self.kept["known"]
        stated, camera = self.lens or self.photo_camera or self.camera, self.camera
        levels = self.mask.kept(stated.height, stated.width)[..., None]
        if self.lens is not None:
            levels = self.lens.undistort(np.repeat(levels, 3, axis=2))[..., :1]
        if self.photo_camera is not None:
            photo = self.photo_camera.height, self.photo_camera.width
            share = resize_cover(levels, camera.height, camera.width, photo)
        else:
            share = levels / np.float32(255)
        known = None if (share >= 0.5).all() else share[..., 0] >= 0.5
        if self.kept is not None:
            self.kept["known"] = known
        return known

    @property
    def is_on_background(self) -> bool:
        """Whether nothing is where pixels do not count; otherwise something moves there."""
        return self.mask is not None and self.mask.is_background

    def judged(self) -> NDArray:
        """What pictures are held against: `image` with NaN where pixels do not count; its errors."""
        image, known = self.image(), self.known()
        return image if known is None else np.where(known[..., None], image, np.float32(np.nan))

    def photo(self, least: tuple[int, int] | None = None) -> NDArray:
        """Read the photo: (H, W, 3) uint8 as it was taken, without its lens's distortion.

        Args:
            least: (height, width) of pictures that it is enough for; None for the whole photo. A large JPEG is read a
                half or a quarter as large, but twice as large as these at least.

        Raises:
            InputError: names the photo, which cannot be read or is not of the size that its camera states.
        """
        stated = self.lens or self.photo_camera or self.camera
        shrink = 1 if least is None else self._shrink(*least)
        if self.video is None:
            pixels = read_image(self.path, shrink=shrink, upright=not self.is_stored)
        else:
            pixels = self.video.frame(self.index)
        if self.video is not None and pixels.shape[:2] != (stated.height, stated.width) == self.video.stored:
            pixels = self.video.frame(self.index, is_square=False)
        if shrink > 1 and pixels.shape[:2] != (stated.height, stated.width):
            if pixels.shape[:2] == (stated.height // shrink, stated.width // shrink):
                return pixels
            pixels = read_image(self.path, upright=not self.is_stored)
        if pixels.shape[:2] == (stated.width, stated.height) != (stated.height, stated.width) and self.video is None:
            pixels = read_image(self.path, upright=False)
            if pixels.shape[:2] == (stated.height, stated.width):
                fault = f"taken as stored, {stated.width}x{stated.height}, as its camera is of that size"
                warn(f"{self.path}: {fault}; its Exif orientation turns it")
        if pixels.shape[:2] != (stated.height, stated.width):
            fault = f"{pixels.shape[1]}x{pixels.shape[0]} pixels, but its camera states {stated.width}x{stated.height}"
            is_turned = pixels.shape[:2] == (stated.width, stated.height)
            turned = ": the photo was turned after its camera was found; turn it back" if is_turned else ""
            raise InputError(f"{fault}{turned}", where=str(self.path))
        return pixels if self.lens is None else self.lens.undistort(pixels)

    def _shrink(self, height: int, width: int) -> int:
        """By how much a photo may be read smaller that is enough for pictures of a size."""
        photo = self.photo_camera or self.camera
        if self.lens is not None or self.video is not None or photo.height * photo.width < LARGE_PHOTO:
            return 1
        share = max(height / photo.height, width / photo.width)
        return max(n for n in (1, 2, 4) if n == 1 or (2 * n * share <= 1 and not (photo.height % n or photo.width % n)))


def even_sizes(frames: Iterable[Frame]) -> tuple[Frame, ...]:
    """Frames of one size where their photos have one: undistorted, those of two cameras differ by a few pixels."""
    frames = tuple(frames)
    photos = {(stated.height, stated.width) for stated in (frame.lens or frame.camera for frame in frames)}
    heights, widths = ({getattr(frame.camera, side) for frame in frames} for side in ("height", "width"))
    if len(photos) != 1 or (len(heights) == 1 and len(widths) == 1):
        return frames
    return tuple(frame.resized(min(heights), min(widths)) for frame in frames)


@dataclass(frozen=True, eq=False)
class Scene:
    """Photos of one static scene with their cameras.

    Attributes:
        path: where the scene comes from; what messages name.
        frames: photos and cameras, in capture order.
        near, far: smallest and largest depth z of interest, scene units, or None when unknown.
        is_estimated: whether near or far was found from the photos, where nobody stated it.

    Raises:
        InputError: there are no frames, or not 1 / MAX_DEPTH < near < far < MAX_DEPTH.
    """

    path: Path
    frames: tuple[Frame, ...]
    near: float | None = None
    far: float | None = None
    is_estimated: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "frames", tuple(self.frames))
        if not self.frames:
            raise InputError("no frames, expected at least one", where=str(self.path))
        for i, frame in enumerate(self.frames):
            check_is_in_pixels(frame.photo_camera or frame.camera, f"{self.path}: frames[{i}].K")
        for name in ("near", "far"):
            value = getattr(self, name)
            if value is not None:
                check_depth(value, f"{self.path}: {name}")
        if self.near is not None and self.far is not None and not self.near < self.far:
            raise InputError(f"near {self.near:g} and far {self.far:g}, expected near < far", where=str(self.path))

    def __repr__(self) -> str:
        camera = self.frames[0].camera
        depths = "".join(f", {name} {getattr(self, name):g}" for name in ("near", "far") if getattr(self, name))
        return f"Scene({str(self.path)!r}: {len(self.frames)} views of {camera.width}x{camera.height}{depths})"

    @property
    def name(self) -> str:
        """The folder's own name."""
        return self.path.resolve().name

    @property
    def cameras(self) -> list[Camera]:
        """One camera per frame."""
        return [frame.camera for frame in self.frames]

    def between(self, near: float | None, far: float | None) -> Scene:
        """The scene between other depths, where they are not None."""
        return replace(self, near=self.near if near is None else near, far=self.far if far is None else far)

    def views(self, indices: Iterable[int]) -> Scene:
        """The scene of some of its frames, in the order given.

        Raises:
            InputError: an index is no whole number, out of range, negative or given twice, or there is none.
        """
        if isinstance(indices, str | bytes) or not isinstance(indices, Iterable):
            raise InputError(f"{type_of(indices)}, expected a list of whole numbers", where="views")
        chosen = []
        for i in indices:
            try:
                chosen.append(operator.index(i))
            except TypeError:
                raise InputError(f"{str(i)[:40]}, expected a whole number", where="views") from None
        for position, i in enumerate(chosen):
            if not 0 <= i < len(self.frames):
                last = len(self.frames) - 1
                raise InputError(f"view {i}, but the scene's views are 0 to {last}", where=str(self.path))
            if i in chosen[:position]:
                raise InputError(f"view {i} given twice, expected each once", where=str(self.path))
        if not chosen:
            raise InputError("no views chosen, expected at least one", where=str(self.path))
        return replace(self, frames=tuple(self.frames[i] for i in chosen))

    def with_masks(self, meaning: str | None) -> Scene:
        """The scene whose masks say what is `moving` or where `background` is; with None, without them."""
        frames = []
        for frame in self.frames:
            mask = frame.mask and replace(frame.mask, is_background=meaning == BACKGROUND)
            kept: dict[str, NDArray | None] | None = None if frame.kept is None else {}
            frames.append(replace(frame, mask=mask if meaning else None, kept=kept))
        return replace(self, frames=tuple(frames))

    def resized(self, height: int, width: int) -> Scene:
        """Every photo scaled to cover height × width, then cropped around its centre; cameras adjusted."""
        for name, side in (("height", height), ("width", width)):
            if isinstance(side, bool) or not isinstance(side, Integral) or side < 1:
                raise InputError(f"{str(side)[:40]}, expected a whole number of 1 or more", where=name)
        room = KEPT_BYTES // (12 * int(height) * int(width))
        resized = (frame.resized(int(height), int(width), keep=i < room) for i, frame in enumerate(self.frames))
        return replace(self, frames=tuple(resized))

    def images(self, told: Told = NOBODY, *, judged: bool = False) -> NDArray:
        """Read the photos.

        Args:
            told: is told of each photo.
            judged: as `Frame.judged` has them, in place of `Frame.image`.

        Returns:
            (V, H, W, 3) float32 in [0, 1]; of `judged`, NaN where pixels do not count.

        Raises:
            InputError: names the photo that cannot be read or has another size than its camera or the first frame.
        """
        self.check_one_size()
        camera = self.frames[0].camera
        images = np.empty((len(self.frames), camera.height, camera.width, 3), np.float32)
        for v, frame in enumerate(told.progress("reading photos", self.frames)):
            images[v] = frame.judged() if judged else frame.image()
        return images

    def check_one_size(self) -> None:
        """InputError that names a photo whose camera is of another size than the first one's."""
        first = self.frames[0].camera
        for frame in self.frames:
            width, height = frame.camera.width, frame.camera.height
            if (width, height) != (first.width, first.height):
                fault = f"{width}x{height} pixels, but {self.frames[0].path} has {first.width}x{first.height}"
                raise InputError(f"{fault}; choose one size with --size WxH", where=str(frame.path))

    def depth_range(self) -> tuple[float, float]:
        """(near, far), or InputError naming the options when the scene does not state them."""
        if self.near is None or self.far is None:
            missing = " and ".join(name for name in ("near", "far") if getattr(self, name) is None)
            options = " and ".join(f"--{name}" for name in missing.split(" and "))
            raise InputError(f"the depth range lacks {missing}; give {options}", where=str(self.path))
        return self.near, self.far
