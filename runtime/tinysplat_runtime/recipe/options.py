"""Options: each is a field of a data class that says all there is to say of it, in this one place.

    qp: float | None = option(number, metavar="Q", help="steps coarser by 2^(Q/6); default 0")

From it come the parser of a command line, what manifests and Python may give, the check of what they gave, and the
pages of documentation. A field's `kind` takes what was given, a word or a value, and returns the value.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar, TypeVar

from ..errors import InputError, within
from .words import shown

Asked = TypeVar("Asked", bound="Options")


@dataclass(frozen=True)
class Option:
    """What is known of an option beside its name, its type and its default.

    Attributes:
        kind: a function of `words`.
        help: what `--help` says, in a line.
        metavar: what stands there for the value; empty for flags.
        group: heading under which `--help` lists it; empty for none.
        choices: the values that there are; empty where that is no list.
        usual: what the option without a value stands for, in Python True; None where it needs one.
        off: what `--no-…` stands for, in Python False; None where there is no such word.
        off_help: what `--help` says of that.
    """

    kind: Callable[[object], object]
    help: str
    metavar: str = ""
    group: str = ""
    choices: Sequence[object] = ()
    usual: object = None
    off: object = None
    off_help: str = ""

    def read(self, name: str, given: object) -> object:
        """The value of what was given; InputError names the option."""
        if given is True and self.usual is not None:
            given = self.usual
        if given is False and self.off is not None:
            given = self.off
        with within(name):
            value = self.kind(given)
        if self.choices and value not in self.choices:
            raise InputError(f"{shown(given)}, accepted are {', '.join(map(str, self.choices))}", where=name)
        return value


def option(kind: Callable[[object], object], default: object = None, *, help: str, **about: Any) -> Any:
    """A field of `Options`; `about` are further fields of `Option`."""
    return field(default=default, metadata={"option": Option(kind, help, **about)})


class Options:
    """A data class whose fields are options; made from what was given, in words or as values, it holds the values.

    None stands for the default of any option.

    Raises:
        InputError: names the option: what stands for no value of its kind.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __post_init__(self) -> None:
        for name, about in self.options().items():
            given, default = getattr(self, name), self.__dataclass_fields__[name].default
            value = default if given is None or given is default else about.read(name, given)
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls: type[Asked], *what: Any, **options: Any) -> Asked:
        """One of options by name, for callers whose names were not checked before; see the class.

        Raises:
            InputError: an option that there is not, and what the class refuses.
        """
        unknown, known = sorted(set(options) - set(cls.options())), sorted(cls.options())
        if unknown:
            raise InputError(f"unknown {', '.join(unknown)[:80]}, accepted are {', '.join(known)}")
        return cls(*what, **options)

    @classmethod
    def options(cls, *, without: Collection[str] = ()) -> dict[str, Option]:
        """Its options by name, in order, but for some names and groups."""
        every = {one.name: one.metadata["option"] for one in fields(cls) if "option" in one.metadata}
        return {name: option for name, option in every.items() if not {name, option.group} & set(without)}

    def given(self) -> dict[str, Any]:
        """The values that are not the defaults, by name."""
        values = {name: getattr(self, name) for name in self.options()}
        return {name: value for name, value in values.items() if value != self.__dataclass_fields__[name].default}
