"""Gaussians of the package ffgs, which runs feedforward models of many authors in one way.

    from ffgs import …                                # pipe = …; see that package
    ts.compress(from_ffgs(pipe(views)))

Source: ffgs 0.1 (Apache-2.0), `types.Gaussians` and `pipeline.GSOutput`. Nothing of it is imported here.
"""

from typing import Any

import numpy as np

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera


def from_ffgs(output: Any, index: int = 0) -> Gaussians:
    """A scene of a `GSOutput`, as a list without what is invisible there, such as the padding of a batch.

    Args:
        output: what a pipeline returned; brought to the world of the views' cameras where these had any, else left in
            the model's own frame.
        index: which scene of the batch.

    Returns:
        (N,) Gaussians; cameras that the model found itself are their viewpoints.

    Raises:
        InputError: nothing is visible, or numbers are out of range.
    """
    output = output.to_world() if output.frame is not None else output
    given = output.gaussians
    tensors = {name: getattr(given, name) for name in ("means", "quats", "scales", "opacities")} | {"sh": given.sh()}
    fields = {name: tensor[index].detach().cpu().float().numpy() for name, tensor in tensors.items()}
    is_shown = fields["opacities"] > 0
    if not is_shown.any():
        raise InputError("all are 0: there is nothing to show", where="opacities")
    viewpoints = []
    if output.cameras is not None:
        height, width = output.cameras.image_shape
        for K, c2w in zip(output.cameras.pixel_k[index], output.cameras.c2w[index], strict=True):
            own, placed = (np.asarray(matrix.detach().cpu(), np.float64) for matrix in (K, c2w))
            viewpoints.append(Camera(own, placed, width, height))
    return Gaussians(**{name: array[is_shown] for name, array in fields.items()}, viewpoints=tuple(viewpoints))
