"""Options: each is a field of a data class that says all there is to say of it, in this one place.

    qp: float | None = option(number, metavar="Q", help="steps coarser by 2^(Q/6); default 0")

From it come a command's parser, what manifests and Python may give, the check of what they gave, and the pages of
documentation. A field's `kind` (`kinds`) takes what was given, a word or a value, and returns the value.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

from ..errors import InputError, within
from . import kinds

Asked = TypeVar("Asked", bound="Options")

REQUIRED = MISSING
"""In place of a default: the option has to be given."""


@dataclass(frozen=True)
class Option:
    """What is known of an option beside its name, its type and its default.

    Attributes:
        kind: a function of `kinds`, or another of their kind.
        help: what `--help` says, in a line.
        metavar: what stands there for the value, by default its choices; empty for flags.
        group: heading under which `--help` lists it, its class's; empty for none.
        choices: the values that there are; empty where that is no list.
        usual: what the option without a value stands for, in Python True; None where it needs one.
        off: what `--no-…` stands for, in Python False; None where there is no such word.
        off_help: what `--help` says of that.
        against: names of options that it contradicts.
        needs: names of options, one of which it takes to mean something.
        only: the ending of the outputs that it is about; empty for any.
        short: its letter on a command line; empty for none.
        word: its word there, if that is not its name.
        is_bare: whether its value stands there without any word.
        is_many: whether it can be given several times, and the value is a tuple.
        is_required: whether it has no default.
    """

    kind: Callable[[object], object]
    help: str
    metavar: str = ""
    group: str = ""
    choices: Sequence[object] = ()
    usual: object = None
    off: object = None
    off_help: str = ""
    against: Sequence[str] = ()
    needs: Sequence[str] = ()
    only: str = ""
    short: str = ""
    word: str = ""
    is_bare: bool = False
    is_many: bool = False
    is_required: bool = False

    def read(self, name: str, given: object) -> object:
        """The value of what was given; InputError names the option."""
        if given is True and self.usual is not None:
            given = self.usual
        if given is False and self.off is not None:
            given = self.off
        with within(name):
            return tuple(map(self._value, kinds.items(given))) if self.is_many else self._value(given)

    def _value(self, given: object) -> object:
        value = self.kind(given)
        if self.choices and value not in self.choices:
            raise InputError(f"{kinds.shown(given)}, accepted are {', '.join(map(str, self.choices))}")
        return value


def option(kind: Callable[[object], object], default: object = None, *, help: str, **about: Any) -> Any:
    """A field of `Options`; `about` are further fields of `Option`."""
    about.setdefault("metavar", "|".join(map(str, about.get("choices", ()))))
    return field(default=default, metadata={"option": Option(kind, help, is_required=default is REQUIRED, **about)})


def flag(default: bool = False, *, help: str, **about: Any) -> Any:
    """`option` of what is so or not."""
    return option(kinds.flag, default, help=help, **about)


class Options:
    """A data class whose fields are options; made from what was given, in words or as values, it holds the values.

    None stands for the default of any option. The `group` of a class is the heading under which `--help` lists those
    that it states itself.

    Raises:
        InputError: names the option: what stands for no value of its kind, or contradicts another.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __init_subclass__(cls, *, group: str = "", **others: Any) -> None:
        super().__init_subclass__(**others)
        for stated in [one for one in vars(cls).values() if isinstance(one, Field) and "option" in one.metadata]:
            stated.metadata = MappingProxyType({"option": replace(stated.metadata["option"], group=group)})

    def __post_init__(self) -> None:
        for name, about in self.options().items():
            given, default = getattr(self, name), self.__dataclass_fields__[name].default
            value = default if given is None or given is default else about.read(name, given)
            object.__setattr__(self, name, value)
        given = list(self.given())
        for i, name in enumerate(given):
            for other in given[:i]:
                if self.contradict(name, other):
                    raise InputError(f"given with {other}, which contradicts it; expected one of them", where=name)
            needed = [one for one in self.options()[name].needs if one in self.options()]
            if getattr(self, name) and needed and not any(getattr(self, one) for one in needed):
                raise InputError(f"given without {needed[0]}, without which it does nothing", where=name)

    @classmethod
    def contradict(cls, name: str, other: str) -> bool:
        """Whether two of its options cannot both be given."""
        options = cls.options()
        return other in options[name].against or name in options[other].against

    def check_output(self, path: str) -> None:
        """InputError where an option is given that says nothing about an output of this name."""
        for name in self.given():
            only = self.options()[name].only
            if only and not path.lower().endswith(only):
                raise InputError(f"of {only} files, expected none with {path}", where=name)

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
