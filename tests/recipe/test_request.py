"""What can be asked for: types, ranges and contradictions, and that each option is stated once."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scenes import tells

from tinysplat_runtime.cli.parser import build_parser
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe import words
from tinysplat_runtime.recipe.request import ENCODE_OPTIONS, Coding, EncodeRequest
from tinysplat_runtime.recipe.words import AutoViews, Refinement


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"qp": "4"}, "qp: "),
        ({"qp": True}, "qp: "),
        ({"qp": math.nan}, "qp: "),
        ({"near": "2"}, "near: "),
        ({"lossless": 1}, "lossless: "),
        ({"profile": 3}, "profile: "),
        ({"profile": "best"}, "profile: "),
        ({"mode": None}, "mode: "),
        ({"mode": "film"}, "mode: "),
        ({"model": 4}, "model: "),
        ({"target_size": 2.5}, "target_size: "),
        ({"target_size": "much"}, "target_size: "),
        ({"target_psnr": 120}, "target_psnr: "),
        ({"target_psnr": 40, "qp": 0}, "target_psnr: "),
        ({"target_psnr": 40, "mode": "photos"}, "mode: "),
        ({"lossless": True, "profile": "fast"}, "profile: "),
        ({"like": 3}, "like: "),
        ({"views": 3}, "views: "),
        ({"views": [0, "1"]}, "views: "),
        ({"views": "0,b"}, "views: "),
        ({"views": "auto:1"}, "views: "),
        ({"size": [0, 4]}, "size: "),
        ({"size": "wide"}, "size: "),
        ({"refine": 2.5}, "refine: "),
        ({"refine": "soon"}, "refine: "),
        ({"refine": 3, "mode": "auto"}, "refine: "),
        ({"first_number": 2}, "first_number: "),
        ({"unit": 3}, "unit: "),
        ({"quality": 3}, "quality"),
    ],
    ids=str,
)
def test_what_cannot_be_used_is_named_with_what_can(options, said: str) -> None:
    with pytest.raises(InputError) as caught:
        EncodeRequest.of("desk", **options)
    assert tells(str(caught.value), said) and "\n" not in str(caught.value)


def test_options_in_words_and_as_values_are_the_same_request() -> None:
    words = EncodeRequest.of("d", views="0,4", size="48x32", target_size="1.5KB", refine="20")
    assert words == EncodeRequest.of("d", views=np.array([0, 4]).tolist(), size=[32, 48], target_size=1500, refine=20)
    assert EncodeRequest.of("d", views="auto", refine="2.5s", size="full") == EncodeRequest(
        "d", views=AutoViews(), refinement=Refinement(seconds=2.5), size="full"
    )


def test_refinement_may_be_taken_back_in_words_and_as_a_value() -> None:
    assert EncodeRequest.of("d", refine="no") == EncodeRequest.of("d", refine=False) != EncodeRequest.of("d")
    assert EncodeRequest.of("d", refine=True) == EncodeRequest.of("d", refine="auto")
    assert not words.refinement("no") and words.refinement(str(words.refinement("no"))) == words.refinement("no")


def test_numbers_of_numpy_and_paths_are_taken() -> None:
    assert EncodeRequest.of("d", qp=np.float64(2)).coding == Coding(qp=np.int64(2))
    assert EncodeRequest.of(Path("d"), poses=Path("p")).poses == Path("p")


def test_the_command_has_every_option_and_states_no_default_of_its_own() -> None:
    _, commands = build_parser()
    found = vars(commands.choices["encode"].parse_args(["SCENE", "-o", "a.tsplat"]))
    assert {name: found[name] for name in ENCODE_OPTIONS if found[name]} == {}
