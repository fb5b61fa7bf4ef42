"""3D Gaussians and the layers they come in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..scene.cameras import MAX_POSITION, Camera
from .notes import NO_NOTES, Notes
from .sh import resized_sh, sh_degree

FIELDS: dict[str, tuple[int, ...]] = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh": (-1, 3)}
"""Arrays of a Gaussian and their trailing shapes; −1 is the number of SH basis functions."""


@dataclass(frozen=True, eq=False, repr=False)
class Gaussians:
    """A set of 3D Gaussians; with `cameras`, one per pixel of V views.

    The leading shape is (V, H, W) when per pixel and (N,) otherwise; arrays are float32 in C order.

    Attributes:
        means: (…, 3) centres in the world frame relative to `origin`, scene units.
        quats: (…, 4) rotations, wxyz, any non-zero length.
        scales: (…, 3) standard deviations along the local axes, scene units, ≥ 0.
        opacities: (…) in [0, 1].
        sh: (…, B, 3) coefficients of the 3DGS basis, B = (degree + 1)².
        cameras: one per view, sizes equal to (H, W); empty of a list.
        origin: (3,) float64, world position that `means` are relative to.
        extra_layers: coarser grids behind this one, each a per-pixel Gaussians of its own cameras and no layers.
        notes: what their maker says about them; `with_notes` sets it.
        viewpoints: of a list, cameras of the photos that it was made from, as far as they are known.

    Raises:
        InputError: names the field, the first index at fault and what is accepted.
    """

    means: NDArray
    quats: NDArray
    scales: NDArray
    opacities: NDArray
    sh: NDArray
    cameras: tuple[Camera, ...] = ()
    origin: NDArray = field(default_factory=lambda: np.zeros(3))
    extra_layers: tuple[Gaussians, ...] = ()
    notes: Notes = NO_NOTES
    viewpoints: tuple[Camera, ...] = ()

    def __post_init__(self) -> None:
        lead = np.shape(self.opacities)
        for name, trailing in FIELDS.items():
            array = _float32(name, getattr(self, name))
            fits = array.shape[: len(lead)] == lead and array.ndim == len(lead) + len(trailing)
            if not fits or any(n not in (-1, m) for n, m in zip(trailing, array.shape[len(lead) :], strict=True)):
                wanted = (*lead, *("B" if n == -1 else n for n in trailing))
                raise InputError(f"shape {array.shape}, expected {wanted} as opacities have {lead}", where=name)
            object.__setattr__(self, name, array)
        sh_degree(self.sh.shape[-2])
        origin = np.array(self.origin, np.float64)
        if origin.shape != (3,) or not (np.abs(origin) <= MAX_POSITION).all():
            fault = str(np.array(self.origin).tolist())[:80]
            raise InputError(f"{fault}, expected three numbers of at most {MAX_POSITION:g}", where="origin")
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "cameras", tuple(self.cameras or ()))
        object.__setattr__(self, "extra_layers", tuple(self.extra_layers))
        object.__setattr__(self, "viewpoints", tuple(self.viewpoints or ()))
        self._check_grid()
        self._check_values()

    def _check_grid(self) -> None:
        lead = self.opacities.shape
        if len(lead) not in (1, 3) or 0 in lead:
            raise InputError(f"leading shape {lead}, expected (N,) or (V, H, W), none of them 0", where="opacities")
        if self.cameras:
            sizes = [(c.height, c.width) for c in self.cameras]
            if len(lead) != 3 or len(sizes) != lead[0] or any(s != lead[1:] for s in sizes):
                raise InputError(
                    f"{len(sizes)} of sizes {sizes[:3]}…, expected one per view of {lead}", where="cameras"
                )
        if self.cameras and self.viewpoints:
            raise InputError(f"{len(self.viewpoints)} beside the cameras of pixels, expected none", where="viewpoints")
        for n, layer in enumerate(self.extra_layers, start=1):
            if not layer.is_per_pixel or layer.extra_layers or len(layer.cameras) != len(self.cameras):
                raise InputError("expected per-pixel Gaussians of as many views, without layers", where=f"layer{n}")
            if (layer.origin != self.origin).any():
                raise InputError(f"{layer.origin.tolist()}, expected {self.origin.tolist()}", where=f"layer{n}_origin")

    def _check_values(self) -> None:
        for name in FIELDS:
            array = getattr(self, name)
            if not np.isfinite(array).all():
                _refuse(name, array, ~np.isfinite(array), "finite numbers")
        if self.opacities.min() < 0 or self.opacities.max() > 1:
            _refuse("opacities", self.opacities, (self.opacities < 0) | (self.opacities > 1), "0 to 1 (linear)")
        if self.scales.min() < 0:
            _refuse("scales", self.scales, self.scales < 0, "≥ 0 (linear standard deviations, not logarithms)")
        zero = np.logical_not(self.quats.any(axis=-1))
        if zero.any():
            _refuse("quats", self.quats, zero, "a non-zero quaternion")

    @classmethod
    def unchecked(cls, **fields: object) -> Gaussians:
        """Build without validation, for arrays whose making already proves them right (the decoder's)."""
        self = object.__new__(cls)
        defaults = {"cameras": (), "origin": np.zeros(3), "extra_layers": (), "notes": NO_NOTES, "viewpoints": ()}
        for name, value in {**defaults, **fields}.items():
            object.__setattr__(self, name, value)
        return self

    @classmethod
    def stacked(cls, layers: Sequence[Gaussians]) -> Gaussians:
        """Layers as one object, with what the first one has besides."""
        return layers[0].changed(extra_layers=tuple(layers[1:]))

    def changed(self, **fields: object) -> Gaussians:
        """The same with other fields, `unchecked`."""
        return Gaussians.unchecked(**{**vars(self), **fields})

    @property
    def is_per_pixel(self) -> bool:
        """Whether there is one Gaussian per pixel of known cameras."""
        return bool(self.cameras)

    def check_pixels(self) -> None:
        """InputError for a list."""
        if not self.is_per_pixel:
            raise InputError("a list; expected (V, H, W, …) with K and c2w per view", where="gaussians")

    @property
    def layers(self) -> tuple[Gaussians, ...]:
        """All layers, this one first."""
        return (self, *self.extra_layers)

    @property
    def degree(self) -> int:
        """SH degree, 0 to 4."""
        return sh_degree(self.sh.shape[-2])

    @property
    def count(self) -> int:
        """Number of Gaussians over all layers."""
        return sum(layer.opacities.size for layer in self.layers)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays of all layers."""
        return sum(getattr(layer, name).nbytes for layer in self.layers for name in FIELDS)

    def flat(self) -> Gaussians:
        """All layers as one (N,) set, whose viewpoints the cameras are; lower SH degrees are padded with zeros to the
        highest.
        """
        parts = [layer.changed(**{name: layer.listed(name) for name in FIELDS}) for layer in self.layers]
        fields = joined(parts) if len(parts) > 1 else {name: getattr(parts[0], name) for name in FIELDS}
        viewpoints = self.cameras or self.viewpoints
        return Gaussians.unchecked(**fields, origin=self.origin, notes=self.notes, viewpoints=viewpoints)

    def listed(self, name: str) -> NDArray:
        """One of `FIELDS` of this layer alone, (N, …)."""
        array: NDArray = getattr(self, name)
        return array.reshape(self.opacities.size, *array.shape[self.opacities.ndim :])

    def taken(self, rows: ArrayLike) -> Gaussians:
        """Those at `rows` (n,), integer or bool, of the first axis, in this order; cameras stay."""
        return self.changed(**{name: getattr(self, name)[rows] for name in FIELDS})

    def __repr__(self) -> str:
        shape = "x".join(map(str, self.opacities.shape))
        layers = f", {len(self.layers)} layers of {self.count} in all" if self.extra_layers else ""
        return f"Gaussians({shape}, SH degree {self.degree}{layers})"

    def _repr_png_(self) -> bytes | None:
        """A notebook's picture of the first view."""
        from ..render.notebook import png

        return png(self)

    def _repr_html_(self) -> str:
        """A notebook's summary."""
        from ..render.notebook import html

        return html(self)

    def with_notes(self, notes: Notes) -> Gaussians:
        """The same Gaussians with other words of their maker's."""
        return self.changed(notes=notes)


def joined(parts: Sequence[Gaussians]) -> dict[str, NDArray]:
    """Arrays of several along their first axis, of the highest SH degree among them."""
    functions = max(part.sh.shape[-2] for part in parts)
    arrays = {name: [getattr(part, name) for part in parts] for name in FIELDS}
    arrays["sh"] = [resized_sh(sh, functions) for sh in arrays["sh"]]
    return {name: np.concatenate(of_all) for name, of_all in arrays.items()}


def _float32(name: str, value: ArrayLike) -> NDArray:
    try:
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinity and is refused by name
            return np.ascontiguousarray(value, np.float32)
    except (TypeError, ValueError):
        raise InputError("not an array of numbers", where=name) from None


def _refuse(name: str, array: NDArray, bad: NDArray, accepted: str) -> None:
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    raise InputError(
        f"{array[index].tolist()} ({int(bad.sum())} such), expected {accepted}", where=f"{name}{list(index)}"
    )
