"""Options on a command line: the words of a class's fields, what they become, and how what is wrong is named."""

from argparse import ArgumentParser
from dataclasses import dataclass

import pytest

from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.options import REQUIRED, Options, option


@dataclass(frozen=True, kw_only=True)
class Picnic(Options):
    guests: tuple[str, ...] = option(kinds.text, REQUIRED, is_bare=True, is_many=True, metavar="WHO", help="who comes")
    place: str = option(kinds.text, REQUIRED, short="p", metavar="WHERE", help="where it is")
    cakes: tuple[int, ...] = option(kinds.count, (2,), is_many=True, metavar="N", help="pieces of each")
    is_late: bool = option(kinds.flag, False, word="24h", help="open end")
    tea: str | None = option(kinds.text, metavar="KIND", usual="green", off="none", choices=("green", "none"), help="")
    sugar: bool = option(kinds.flag, False, needs=("tea",), help="for the tea")


def given(*words: str) -> Picnic:
    parser = ArgumentParser()
    add_options(parser, Picnic)
    return asked(parser.parse_args(words), Picnic)


def test_words_and_values_are_the_same() -> None:
    assert given("ann", "-p", "lake") == Picnic(guests=["ann"], place="lake")
    words = given("ann", "bob", "--place", "hill", "--cakes", "3", "--cakes", "1", "--24h", "--tea", "--sugar")
    assert words == Picnic(guests=("ann", "bob"), place="hill", cakes=[3, 1], is_late=True, tea=True, sugar=True)
    assert (words.cakes, words.tea, given("ann", "-p", "lake", "--no-tea").tea) == ((3, 1), "green", "none")


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--cakes", "0"], "--cakes: '0', expected 1 or more"), (["--sugar"], "--sugar: given without --tea")],
)
def test_what_is_wrong_is_named_by_its_word(words: list[str], said: str) -> None:
    with pytest.raises(InputError) as caught:
        given("ann", "-p", "lake", *words)
    assert str(caught.value).startswith(said)


def test_what_is_required_is_asked_for_by_python_too() -> None:
    with pytest.raises(TypeError, match="place"):
        Picnic(guests=["ann"])
