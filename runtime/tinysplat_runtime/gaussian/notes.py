"""What the maker of a scene says about it: its unit, whom to name, under which licence it may be used.

Text for people, shown and handed on, never interpreted. Trust boundary: it is short, and holds nothing that could steer
a terminal or change the order in which it reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..errors import InputError, check_is
from ..system.printable import unprinted

MAX_BYTES = {"unit": 32, "attribution": 1024, "licence": 128, "refined": 128, "antialiased": 3, "pruned": 128}
"""Longest text of a field in UTF-8."""

OPTIONS = ("unit", "attribution", "licence")
"""Notes that the author of a file sets; they are stored unchanged."""

YES = "yes"


@dataclass(frozen=True)
class Notes:
    """Text that goes with a scene; empty where nothing was said.

    Attributes:
        unit: of lengths, such as metre.
        attribution: whom to name, and what was changed.
        licence: an SPDX expression such as CC-BY-4.0, or an address.
        refined: how the Gaussians were corrected after a network made them; what corrects them says it, not the maker.
        antialiased: `yes` of Gaussians that were trained to fade where they are widened (Mip-Splatting); carried from
            file to file, and not acted on here.
        pruned: how many Gaussians were left out because pictures hardly need them, and the dB of pictures without.

    Raises:
        InputError: names the field: too long, or with characters that do not print.
    """

    unit: str = ""
    attribution: str = ""
    licence: str = ""
    refined: str = ""
    antialiased: str = ""
    pruned: str = ""

    def __post_init__(self) -> None:
        for name, text in asdict(self).items():
            check_is(text, str, name, "text")
            bad = unprinted(text)
            if bad is not None:
                raise InputError(f"holds U+{ord(bad):04X}, expected characters that print, in one line", where=name)
            size = len(text.encode())
            if size > MAX_BYTES[name]:
                raise InputError(f"{size} bytes of UTF-8, expected at most {MAX_BYTES[name]}", where=name)
        if self.antialiased not in ("", YES):
            raise InputError(f"'{self.antialiased}', expected '{YES}' or nothing", where="antialiased")

    def __bool__(self) -> bool:
        return any(self.given().values())

    def given(self) -> dict[str, str]:
        """The fields that are not empty, by name."""
        return {name: text for name, text in asdict(self).items() if text}

    @classmethod
    def joined(cls, parts: Sequence[Notes]) -> Notes:
        """Notes of a scene made from several: every attribution and licence; the rest where all have the same.

        Raises:
            InputError: together they are too long.
        """

        def different(name: str) -> list[str]:
            return list(dict.fromkeys(getattr(part, name) for part in parts))

        def common(name: str) -> str:
            texts = different(name)
            return texts[0] if len(texts) == 1 else ""

        licences = [text for text in different("licence") if text]
        if len(licences) > 1:
            licences = [f"({text})" if " OR " in text else text for text in licences]
        return cls(
            unit=common("unit"),
            attribution="; ".join(filter(None, different("attribution"))),
            licence=" AND ".join(licences),
            refined=common("refined"),
            antialiased=common("antialiased"),
            pruned=common("pruned"),
        )


NO_NOTES = Notes()
NAMES = tuple(field.name for field in fields(Notes))


def known_notes(document: Mapping[str, object]) -> dict[str, Any]:
    """What a document says under names of notes."""
    return {name: document[name] for name in NAMES if name in document}
