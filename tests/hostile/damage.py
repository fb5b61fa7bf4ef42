"""Random damage to bytes: what a broken disk, a cut download or an attacker does, as functions of a random generator.

    from hostile.damage import damage

Nothing here knows a format. The same generator state gives the same damage.
"""

import struct
from random import Random

_FLOATS = (0.0, -0.0, -1.0, 1e-45, 1e-38, 1e-9, 1e9, 1e29, 3e38, float("inf"), float("-inf"), float("nan"))
_DOUBLES = (*_FLOATS, 5e-324, 1e-300, 1e150, 1.7e308)

VALUES: dict[int, tuple[bytes, ...]] = {
    1: tuple(bytes([n]) for n in (0, 1, 2, 3, 7, 31, 51, 52, 127, 128, 254, 255)),
    2: tuple(struct.pack("<H", n) for n in (0, 1, 16, 255, 256, 4096, 4097, 32767, 32768, 65535)),
    4: tuple(struct.pack("<I", n) for n in (0, 1, 1 << 16, (1 << 16) + 1, 1 << 26, 2**31 - 1, 2**31, 2**32 - 1))
    + tuple(struct.pack("<f", x) for x in _FLOATS),
    8: tuple(struct.pack("<Q", n) for n in (1 << 31, 1 << 32, (1 << 63) - 1, 1 << 63, (1 << 64) - 1))
    + tuple(struct.pack("<d", x) for x in _DOUBLES),
}
"""Little-endian numbers at which readers break, by their width in bytes."""


def flip_bits(data: bytearray, rng: Random) -> None:
    """Flip 1 to 8 bits anywhere."""
    for _ in range(rng.randint(1, 8)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def place_value(data: bytearray, rng: Random) -> None:
    """Write one of `VALUES` over an aligned field."""
    width = rng.choice((1, 2, 4, 4, 8))
    if len(data) >= width:
        at = rng.randrange(len(data) // width) * width
        data[at : at + width] = rng.choice(VALUES[width])


def nudge_byte(data: bytearray, rng: Random) -> None:
    """Add a little to one byte: the off-by-one of a length or count."""
    at = rng.randrange(len(data))
    data[at] = (data[at] + rng.choice((-2, -1, 1, 2))) & 255


def overwrite_noise(data: bytearray, rng: Random) -> None:
    """Write random bytes over a run of up to 16."""
    at = rng.randrange(len(data))
    run = min(rng.randint(1, 16), len(data) - at)
    data[at : at + run] = rng.randbytes(run)


def copy_within(data: bytearray, rng: Random) -> None:
    """Copy a run from one place over another."""
    run = rng.randint(1, min(64, len(data)))
    source, target = (rng.randrange(len(data) - run + 1) for _ in range(2))
    data[target : target + run] = data[source : source + run]


def cut(data: bytearray, rng: Random) -> None:
    """Leave out a run, mostly the end."""
    at = rng.randrange(len(data))
    del data[at : None if rng.random() < 0.7 else at + rng.randint(1, 32)]


def insert(data: bytearray, rng: Random) -> None:
    """Put noise or a repetition in between or behind."""
    at = rng.choice((rng.randrange(len(data) + 1), len(data)))
    start = rng.randrange(len(data))
    data[at:at] = rng.choice((rng.randbytes(rng.randint(1, 32)), data[start : start + 32], bytes(rng.randint(1, 64))))


IN_PLACE = (flip_bits, place_value, place_value, nudge_byte, overwrite_noise, copy_within)
ANY = (*IN_PLACE, cut, insert)


def damage(data: bytes, rng: Random, *, keep_length: bool = False) -> bytes:
    """One to three of the above."""
    damaged = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        if damaged:
            rng.choice(IN_PLACE if keep_length else ANY)(damaged, rng)
    return bytes(damaged)
