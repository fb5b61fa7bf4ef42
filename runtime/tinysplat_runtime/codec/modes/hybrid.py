"""Mode `hybrid`: the photos, and planes with what the network's Gaussians lack of the ones that were made before.

Encoder and decoder run the same network on the same decoded photos; `residual` has the arithmetic.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from numpy.typing import NDArray

from ...container.layers import LayerHeader
from ...container.photos import Hybrid
from ...errors import FormatError
from ...gaussian.gaussians import Gaussians
from ...graphs.inference import GraphStore
from ...graphs.walk import predict_grouped
from ..layers import OpenFile, decode_layers
from ..photos import decode_photos
from ..planning import ResidualPlanner
from ..residual import check_prediction, hybrid_settings, predicted_geometry
from . import photos as photo_mode
from .mode import Job, Mode


def encode(job: Job) -> bytes:
    """The file.

    Raises:
        InputError: profile `paper`, or a Q_g beyond ±60.
        NumericError: Gaussians at or behind their own camera.
    """
    settings, scene = hybrid_settings(job.profile), photo_mode.photos_of(job)
    sections, photos = photo_mode.coded_photos(job)
    images = decode_photos(photos.header(), photos.parameter_sets, job.threads)  # what the decoder will see
    with job.stats.watch.stage("network"):
        network = scene.network
        graph = job.store.network_by_hash(network.name, network.sha256, scene.model)
        prediction = predict_grouped(images, job.gaussians.cameras, network.near, network.far, graph, scene.groups)
    # Residuals have no QPs by block, and so no need of coding trees as small as blocks.
    profile = replace(job.profile, encoder=replace(job.profile.encoder, block_qps=False))
    planner = partial(ResidualPlanner, settings=settings, prediction=prediction)
    return replace(job, profile=profile).encoder(planner, sections).encode(job.qp)


def decode(file: OpenFile, body: Hybrid) -> Gaussians:
    """The network's Gaussians, corrected; a file cut behind its photos gives them as they are."""
    return decode_layers(file, body.planes, partial(_base, photo_mode.decode(file, body.photos), file.store))


def _base(prediction: Gaussians, store: GraphStore, index: int, layer: LayerHeader) -> tuple[NDArray, NDArray]:
    """Geometry and SH coefficients that a layer is added to."""
    if index >= len(prediction.layers):
        raise FormatError(f"the network gives {len(prediction.layers)} layers", where=f"layer {index}")
    predicted = prediction.layers[index]
    check_prediction(layer, predicted, index)
    return predicted_geometry(store, predicted, f"layer {index}"), predicted.sh


HYBRID = Mode("hybrid", encode, decode)
