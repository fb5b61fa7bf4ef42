"""What can be asked for: kinds, ranges and contradictions, and that each option is stated once for all doors."""

import inspect
import math
from pathlib import Path

import numpy as np
import pytest
from scenes import make_smooth_gaussians, tells

import tinysplat_runtime as ts
from tinysplat_runtime.cli.parser import build_parser
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe import request
from tinysplat_runtime.recipe.request import CompressRequest, EncodeRequest, ExportRequest
from tinysplat_runtime.recipe.words import AutoViews, Training
from tinysplat_runtime.system.options import Options

REQUESTS = {"encode": EncodeRequest, "compress": CompressRequest, "convert": ExportRequest}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"qp": "four"}, "qp: "),
        ({"qp": True}, "qp: "),
        ({"far": math.inf}, "far: "),
        ({"lossless": 1}, "lossless: "),
        ({"profile": "best"}, "profile: "),
        ({"mode": "film"}, "mode: "),
        ({"target_size": "much"}, "target_size: "),
        ({"target_psnr": 120}, "target_psnr: "),
        ({"target_psnr": 40, "qp": 0}, "target_psnr: "),
        ({"target_psnr": 40, "mode": "photos"}, "mode: "),
        ({"lossless": True, "profile": "fast"}, "lossless: "),
        ({"focal": 70}, "focal: "),
        ({"views": [0, "b"]}, "views: "),
        ({"views": "auto:1"}, "views: "),
        ({"size": [0, 4]}, "size: "),
        ({"size": "wide"}, "size: "),
        ({"train": "soon"}, "train: "),
        ({"train": 0}, "train: "),
        ({"train": 3, "mode": "photos"}, "train: "),
        ({"at_most": 9, "mode": "gaussians"}, "at_most: "),
        ({"at_most": 9, "fast": True}, "at_most: "),
        ({"fast": True, "mode": "list"}, "fast: "),
        ({"first_number": 2}, "first_number: "),
        ({"quality": 3}, "quality"),
    ],
    ids=str,
)
def test_what_cannot_be_used_is_named_with_what_can(options, said: str) -> None:
    with pytest.raises(InputError) as caught:
        EncodeRequest.of("desk", **options)
    assert tells(str(caught.value), said) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"translate": "abc"}, "translate: 'abc'"),
        ({"sh_bits": (5,)}, "sh_bits: (5,)"),
        ({"crop": (1, 2, 3, 4, 5, math.nan)}, "crop: "),
        ({"rotate": "q,90"}, "rotate: 'q,90'"),
        ({"rotate": (0, 0, 0, 0)}, "rotate: "),
        ({"prune": True}, "prune: True"),
        ({"trim_border": 0}, "trim_border: 0"),
        ({"spz_version": 5}, "spz_version: 5, 3, 4"),
        ({"unit": "a\nb"}, "unit: "),
        ({"at_most": 99}, "at_most"),
        ({"scale": 1e30}, "scale: 1e+30"),
    ],
    ids=str,
)
def test_what_cannot_be_exported_is_named_with_what_can(options, said: str) -> None:
    with pytest.raises(InputError) as caught:
        ExportRequest.of(**options)
    assert tells(str(caught.value), said) and "\n" not in str(caught.value)


def test_no_option_takes_what_is_nothing() -> None:
    """Every field of every request is checked, whatever its kind."""
    what = {EncodeRequest: ("desk",), CompressRequest: (make_smooth_gaussians(2, 4, 4, 0),), ExportRequest: ()}
    for kind, given in what.items():
        for name in kind.options():
            with pytest.raises(InputError) as caught:
                kind(*given, **{name: object()})
            assert str(caught.value).startswith(f"{name}: an object, expected "), name


def test_options_in_words_and_as_values_are_the_same_request() -> None:
    words = EncodeRequest("d", views="0,4", size="48x32", target_size="1.5KB", train="20", near="0.5")
    values = EncodeRequest("d", views=np.array([0, 4]), size=[32, 48], target_size=1500, train=20, near=0.5)
    assert words == values
    assert EncodeRequest("d", views="auto", train="2.5s", size="full") == EncodeRequest(
        "d", views=AutoViews(), train=Training(seconds=2.5), size="full"
    )
    words = ExportRequest(sh_bits="8,7", crop="0,0,0,1,1,2", rotate="x,180", translate="1,2,3", dilate=True)
    values = ExportRequest(
        sh_bits=[8, 7], crop=np.array([0, 0, 0, 1, 1, 2]), rotate=("x", 180), translate=(1, 2, 3), dilate=0.16
    )
    assert words == values and np.allclose(words.rotate, (0, 1, 0, 0))


def test_none_stands_for_the_default_of_any_option() -> None:
    for kind, what in ((EncodeRequest, ("d",)), (ExportRequest, ())):
        assert kind(*what, **dict.fromkeys(kind.options())) == kind(*what)


def test_numbers_of_numpy_and_paths_are_taken() -> None:
    assert EncodeRequest("d", qp=np.float64(2)) == EncodeRequest("d", qp=np.int64(2))
    assert EncodeRequest(Path("d"), poses=Path("p")).poses == Path("p")


def test_every_command_has_every_option_and_states_no_default_of_its_own() -> None:
    _, commands = build_parser()
    for command, kind in REQUESTS.items():
        found = vars(commands.choices[command].parse_args(["IN", "-o", "a.tsplat"]))
        assert {name: found[name] for name in kind.options() if found[name]} == {}


@pytest.mark.parametrize(
    ("door", "kind", "keywords"),
    [
        (ts.encode, EncodeRequest, request.EncodeKeywords),
        (ts.compress, CompressRequest, request.CompressKeywords),
        (ts.convert, ExportRequest, request.ExportKeywords),
    ],
)
def test_pythons_functions_declare_every_option_and_no_other(door, kind: type[Options], keywords: type) -> None:
    """So that editors and type checkers know them."""
    declared = keywords.__annotations__.keys() | (inspect.signature(door).parameters.keys() & kind.options().keys())
    assert declared == kind.options().keys()


def test_a_command_line_takes_back_what_is_on_by_itself() -> None:
    from tinysplat_runtime.cli.options import asked

    parse = build_parser()[1].choices["encode"].parse_args
    said, unsaid = (
        asked(parse(["IN", "-o", "a.tsplat", *words]), EncodeRequest, "IN") for words in (["--no-joint"], [])
    )
    assert unsaid.joint and not said.joint
