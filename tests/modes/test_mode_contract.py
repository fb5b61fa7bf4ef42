"""What every mode promises of its files: they come back, are told as theirs, and nothing else is taken for them.

One of the modes is made here: `Toy`, whose body and codec are all that it takes (ARCHITECTURE.md, "I add a mode").
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass, replace
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest
from scenes import assert_same, make_smooth_gaussians, write_scene
from sections import beside, file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime import modes
from tinysplat_runtime.codec.job import EncodeStats, Job, PhotoScene
from tinysplat_runtime.codec.layers import OpenFile
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.bodies import BODIES
from tinysplat_runtime.container.body import Body, Description, Opened
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import ChannelRecord, Picture
from tinysplat_runtime.container.sections import Cursor, NewSection
from tinysplat_runtime.container.writer import Head, write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.modes.mode import Mode, find_mode

RUNTIME = ts.Runtime(threads=1)

# ---- a mode in full: the body of container/toy.py and the mode of modes/toy.py ---------------------------------

TOY_POINTS = b"TOYP"


@dataclass(frozen=True, kw_only=True)
class Toy(Body):
    """Grey balls of one size: how many, and in a row of the table their centres as float16."""

    mode: ClassVar[str] = "toy"
    sign: ClassVar[bytes] = TOY_POINTS
    kinds: ClassVar[frozenset[bytes]] = frozenset({TOY_POINTS})

    count: int

    @classmethod
    def read(cls, file: Opened) -> Toy:
        file.check_rows([PlaneClass.POSITION])
        cursor = Cursor(file.only(TOY_POINTS))
        (count,) = cursor.unpack(struct.Struct("<I"))
        cursor.finish()
        cursor.require(file.table.layer(0)[0].pictures[0].length == 6 * count, f"centres of {count} balls")
        return cls(count=count)

    def describe(self) -> Description:
        return Description(gaussians=self.count, sh_degree=0)


def encode_toy(job: Job) -> bytes:
    means = job.gaussians.flat().means.astype("<f2")
    sections = [NewSection(TOY_POINTS, 0, struct.pack("<I", len(means)))]
    rows = [(0, ChannelRecord(PlaneClass.POSITION, 0, 0, 0.0, 0.0, Picture.each_of([means.tobytes()])))]
    return write_container(Head((), np.zeros(3), "toy", job.qp, job.gaussians.notes), sections, rows, views=1)


def decode_toy(file: OpenFile, body: Toy) -> ts.Gaussians:
    payload = file.container.table.payload(file.container.table.layer(0)[0], 0)
    means = np.frombuffer(payload, "<f2").reshape(body.count, 3).astype(np.float32)
    ones = np.ones((body.count, 4), np.float32)
    return ts.Gaussians(means, ones / 2, ones[:, :3] / 9, ones[:, 0], ones[:, None, :3])


@pytest.fixture(scope="module", autouse=True)
def toy():
    """The line of `BODIES`, and the module that it finds."""
    BODIES.insert(0, Toy)
    module = ModuleType(f"{modes.__name__}.toy")
    module.TOY = Mode("toy", encode_toy, decode_toy)
    sys.modules[module.__name__] = module
    yield
    del sys.modules[module.__name__]
    BODIES.remove(Toy)


# ---- the contract ---------------------------------------------------------------------------------------------------

MANY = "gaussians of many views"
NAMES = ["gaussians", "photos", "lossless", "list", "toy", MANY]
NOTES = ts.Notes(attribution="somebody")


def mode_of(name: str) -> str:
    return "gaussians" if name == MANY else name


@pytest.fixture(scope="module")
def jobs(tmp_path_factory) -> dict[str, Job]:
    scene = ts.load_scene(write_scene(tmp_path_factory.mktemp("photos") / "scene", views=2, height=24, width=40))
    store = RUNTIME.store
    predicted = RUNTIME.predict(scene, "sweep").with_notes(NOTES)
    smooth = make_smooth_gaussians(2, 20, 24, degree=1, layers=2).with_notes(NOTES)
    many = make_smooth_gaussians(8, 16, 16, degree=1).with_notes(NOTES)
    made = {"lossless": smooth, "list": smooth.flat(), "toy": smooth, MANY: many}
    photos = PhotoScene.of(scene, "sweep", store)
    return {
        name: Job(made.get(name, predicted), PROFILES["fast"], 6.0, store, 1, EncodeStats(), photos=photos)
        for name in NAMES
    }


@pytest.fixture(scope="module")
def files(jobs) -> dict[str, bytes]:
    return {name: find_mode(mode_of(name)).encode(job) for name, job in jobs.items()}


def test_every_mode_is_here(files):
    assert set(map(mode_of, files)) == {body.mode for body in BODIES}
    assert all(find_mode(mode).name == mode for mode in map(mode_of, files))


@pytest.mark.parametrize("name", NAMES)
def test_files_come_back_as_finite_gaussians_of_their_mode_with_their_notes(files, name):
    decoded, again = RUNTIME.decompress(files[name]), RUNTIME.decompress(files[name])
    assert read_container(files[name]).mode == mode_of(name)
    assert decoded.notes.attribution == "somebody"
    assert all(np.isfinite(getattr(layer, field)).all() for layer in decoded.layers for field in FIELDS)
    assert_same(decoded, again)


@pytest.mark.parametrize("name", NAMES)
def test_threads_change_neither_bytes_nor_gaussians(files, jobs, name):
    job = replace(jobs[name], threads=3, stats=EncodeStats())
    assert find_mode(mode_of(name)).encode(job) == files[name]
    assert_same(ts.Runtime(threads=3).decompress(files[name]), RUNTIME.decompress(files[name]))


@pytest.mark.parametrize("name", ["gaussians", "lossless", "list"])
def test_one_gaussian_comes_back_alone(name):
    one = make_smooth_gaussians(1, 1, 1, degree=0)
    one = one.flat() if name == "list" else one
    job = Job(one, PROFILES["fast"], -12.0, RUNTIME.store, 1, EncodeStats())
    found = RUNTIME.decompress(find_mode(name).encode(job))
    assert found.count == 1 and len(found.cameras) == len(one.cameras)
    np.testing.assert_allclose(found.means.ravel(), one.means.ravel(), atol=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_info_agrees_with_what_decodes_and_its_bytes_add_up(files, name):
    data, decoded = files[name], RUNTIME.decompress(files[name])
    described = ts.inspect(data)
    assert described["mode"] == mode_of(name) and described["bytes"] == len(data)
    assert described["notes"]["attribution"] == "somebody" and described["qp"] in (0.0, 6.0)
    assert described["views"] == len(decoded.cameras) == len(described["cameras"])
    if described["gaussians"] is not None:
        assert (described["gaussians"], described["sh_degree"]) == (decoded.count, decoded.degree)
    coded = sum(described["bytes_by_class"].values())
    assert 0 < coded == described["bytes"] - described["metadata_bytes"]
    assert not described["views"] or sum(described["bytes_by_view"]) == coded
    planes = sum(plane["bytes"] for plane in described["planes"])
    assert (described["prefixes"][-1]["bytes"] == len(data)) if planes else not described["prefixes"]


@pytest.mark.parametrize("name", NAMES)
def test_a_prefix_shows_something_or_says_what_it_lacks_in_one_line(files, name):
    data = files[name]
    pictures = len(sections_of(data)[-1][3])
    shown = []
    for length in [*range(1, len(data), len(data) // 23), len(data)]:
        try:
            decoded = RUNTIME.decompress(data, max_bytes=length)
        except FormatError as error:
            assert "\n" not in str(error) and not shown
            continue
        shown.append(length)
        assert all(np.isfinite(getattr(decoded, field)).all() for field in FIELDS)
    assert shown[-1] == len(data) and shown[0] >= len(data) - pictures


@pytest.mark.parametrize("name", NAMES)
def test_no_truncated_and_no_longer_file_is_taken_for_whole(files, name):
    data = files[name]
    for length in [*range(0, len(data), max(len(data) // 101, 1)), len(data) - 1]:
        with pytest.raises(FormatError):
            read_container(data[:length])
    with pytest.raises(FormatError):
        read_container(data + b"\0")


@pytest.mark.parametrize("name", NAMES)
def test_a_flipped_byte_anywhere_is_refused(files, name):
    """By the reader, or by whoever takes the picture that it is in."""
    data = bytearray(files[name])
    for at in range(3, len(data), max(len(data) // 211, 1)):
        data[at] ^= 0x20
        with pytest.raises(FormatError):
            container = read_container(bytes(data))
            for _, channel in container.table.rows:
                for view in range(len(channel.pictures)):
                    container.table.payload(channel, view)
            RUNTIME.decompress(bytes(data))
        data[at] ^= 0x20


@pytest.mark.parametrize("name", NAMES)
def test_every_section_is_needed_once(files, name):
    """But for those that are optional; parameter sets may be of no use."""
    sections = sections_of(files[name])
    for at, section in enumerate(sections):
        if section[1] & L.REQUIRED:
            with pytest.raises(FormatError):
                read_container(file_of(sections[:at] + sections[at + 1 :]))
            if section[0] != L.PARAMETER_SETS:
                with pytest.raises(FormatError):
                    read_container(beside(files[name], section))


@pytest.mark.parametrize("name", NAMES)
def test_sections_of_another_mode_are_refused_whatever_their_crc(files, name):
    """A section that decoding would never look at could say anything."""
    sections = sections_of(files[name])
    own = {section[0] for section in sections}
    allowed = type(read_container(files[name]).body).kinds
    for other in NAMES:
        for section in sections_of(files[other]):
            if section[0] in own or not section[1] & L.REQUIRED or mode_of(other) == mode_of(name):
                continue
            with pytest.raises(FormatError):
                read_container(beside(files[name], section))
            broken = bytearray(beside(files[name], [*section[:3], section[3] + b"!"]))
            broken[-len(sections[-1][3]) - 1] ^= 1
            with pytest.raises(FormatError):
                read_container(bytes(broken))
    assert own <= allowed | {L.SCENE, b"NOTE", L.PICTURES, L.DATA}
