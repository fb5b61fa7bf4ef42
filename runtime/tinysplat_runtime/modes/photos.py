"""Mode `photos`: the photos, and the network by its hash, which the receiver runs on them."""

import numpy as np

from ..codec.job import Job, check_qp
from ..codec.layers import OpenFile
from ..codec.photos import decode_photos, encode_photos
from ..container.photos import Photos, photo_sections
from ..container.writer import Head, write_container
from ..gaussian.gaussians import Gaussians
from ..network.walk import predict_grouped
from .mode import Mode


def encode(job: Job) -> bytes:
    """The file; InputError for a Q_g beyond ±60."""
    scene = job.photos
    assert scene is not None
    check_qp(job.qp)
    with job.stats.watch.stage("x265"):
        photos = encode_photos(scene.images, job.qp, job.profile.encoder, job.threads)
    sections = photo_sections(scene.network, photos, scene.groups)
    head = Head(job.gaussians.cameras, np.zeros(3), job.profile.name, job.qp, job.gaussians.notes)
    with job.stats.watch.stage("write"):
        return write_container(head, sections, photos.rows)


def decode(file: OpenFile, body: Photos) -> Gaussians:
    """What the network that the file names makes of its photos.

    Raises:
        FormatError: a photo is damaged.
        ModelError: the network is not at hand.
    """
    container, watch = file.container, file.watch
    network = body.network
    with watch.stage("libavcodec"):
        images = decode_photos(body.photos, file.threads)
    with watch.stage("network"):
        graph = file.store.network_by_hash(network.name, network.sha256, file.model)
        return predict_grouped(images, container.cameras, network.near, network.far, graph, body.groups)


PHOTOS = Mode(Photos.mode, encode, decode)
