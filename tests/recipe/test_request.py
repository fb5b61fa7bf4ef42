"""What can be asked for: types, ranges and contradictions, and that each option is stated once."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

from tinysplat_runtime.cli.parser import build_parser
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.notes import OPTIONS
from tinysplat_runtime.recipe import request as requests
from tinysplat_runtime.recipe import words
from tinysplat_runtime.recipe.request import Coding, EncodeOptions, EncodeRequest
from tinysplat_runtime.recipe.words import AutoViews, Refinement


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"qp": "4"}, "qp: '4', expected a number"),
        ({"qp": True}, "qp: True, expected a number"),
        ({"qp": math.nan}, "qp: nan, accepted are"),
        ({"near": "2"}, "near: '2', expected a number"),
        ({"lossless": 1}, "lossless: 1, expected true or false"),
        ({"profile": 3}, "profile: 3, expected text"),
        ({"profile": "best"}, "profile: 'best', accepted are"),
        ({"mode": None}, "mode: None, expected text"),
        ({"mode": "film"}, "mode: 'film', accepted are gaussians, photos"),
        ({"model": 4}, "model: 4, expected text"),
        ({"target_size": 2.5}, "target_size: 2.5, expected a whole number"),
        ({"target_size": "much"}, "target_size: 'much', expected a size such as"),
        ({"target_psnr": 120}, "target_psnr: 120 dB, expected"),
        ({"target_psnr": 40, "qp": 0}, "target_psnr: given with qp"),
        ({"target_psnr": 40, "mode": "photos"}, "mode: 'photos' with a target"),
        ({"lossless": True, "profile": "fast"}, "profile: given with lossless"),
        ({"like": 3}, "like: 3, expected bytes or a path"),
        ({"views": 3}, "views: 3, expected a list of whole numbers"),
        ({"views": [0, "1"]}, "expected a list of whole numbers"),
        ({"views": "0,b"}, "views: '0,b', expected indices"),
        ({"views": "auto:1"}, "views: 'auto:1', expected auto"),
        ({"size": [0, 4]}, "expected a height and a width"),
        ({"size": "wide"}, "size: 'wide', expected HEIGHTxWIDTH"),
        ({"refine": 2.5}, "refine: 2.5, expected steps such as 20"),
        ({"refine": "soon"}, "refine: 'soon', expected steps"),
        ({"refine": 3, "mode": "auto"}, "refine: with --mode auto"),
        ({"first_number": 2}, "first_number: 2, expected 0 or 1"),
        ({"unit": 3}, "unit: a int, expected text"),
        ({"quality": 3}, "unknown quality, accepted are attribution"),
    ],
    ids=str,
)
def test_what_cannot_be_used_is_named_with_what_can(options, said: str) -> None:
    with pytest.raises(InputError) as caught:
        EncodeRequest.of("desk", **options)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_options_in_words_and_as_values_are_the_same_request() -> None:
    words = EncodeRequest.of("d", views="0,4", size="32x48", target_size="1.5KB", refine="20")
    assert words == EncodeRequest.of("d", views=np.array([0, 4]).tolist(), size=[32, 48], target_size=1500, refine=20)
    assert EncodeRequest.of("d", views="auto", refine="2.5s", size="full") == EncodeRequest(
        "d", views=AutoViews(), refinement=Refinement(seconds=2.5), size="full"
    )
    assert [str(Refinement(steps=7)), str(Refinement(seconds=2.5)), str(Refinement())] == ["7", "2.5s", "auto"]


def test_refinement_on_its_own_takes_seconds_by_the_photos_size():
    asked = words.refinement("auto")
    assert asked == Refinement() and asked.steps is None
    assert asked.seconds_worth(4 * 256 * 256) == pytest.approx(7.9, abs=0.1)
    assert (asked.seconds_worth(100), asked.seconds_worth(10**8)) == (5, 180)
    assert Refinement(seconds=2.5).seconds_worth(10**8) == 2.5 and Refinement(steps=3).seconds_worth(10**8) is None
    assert EncodeRequest.of("d", qp=np.float64(2)).coding == Coding(qp=np.int64(2))
    assert EncodeRequest.of(Path("d"), poses=Path("p")).poses == Path("p")


def test_options_by_name_are_the_fields_and_their_types() -> None:
    """What type checkers are told of `ts.encode` holds what the classes take, of which some have words too."""
    given = get_type_hints(EncodeOptions, vars(requests) | {"Unpack": None})
    nested = {"coding", "refinement", "notes", "scene", "keep_all"}  # the last is of Gaussians of no pixels
    stated = {one.name: one.type for cls in (EncodeRequest, Coding) for one in fields(cls) if one.name not in nested}
    assert set(given) == {*stated, *OPTIONS, "refine"}
    in_words = {"views", "size", "target_size"}
    for name, kinds in stated.items():
        assert name in in_words or EncodeOptions.__annotations__[name].__forward_arg__ == kinds, name


def test_the_command_has_every_option_and_states_no_default_of_its_own() -> None:
    _, commands = build_parser()
    parser = commands.choices["encode"]
    options = {action.dest: action for action in parser._actions if action.option_strings}
    assert set(EncodeOptions.__annotations__) <= set(options)
    assert {name: options[name].default for name in EncodeOptions.__annotations__ if options[name].default} == {}
