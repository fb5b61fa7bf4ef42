"""Fields of JSON documents: what is accepted up to its limits, and what is refused in which words."""

from typing import Any

import pytest
from scenes import tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.intake.fields import Fields


def refusal(error: pytest.ExceptionInfo[InputError]) -> str:
    return str(error.value)


ACCEPTED = ["a.png", "sub/a.png", "..a/b..png", "ß" * 120, "/".join(["x" * 199] * 10)]


@pytest.mark.parametrize("name", [*ACCEPTED, "x" * 240])
def test_names_inside_the_folder_are_taken_as_they_are(name: str) -> None:
    assert Fields({"file": name}).photo("file") == name
    assert Fields({"photo": name, "file": 1}).photo("photo") == name


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({}, ""),
        ({"file": 7}, "7"),
        ({"file": ""}, '""'),
        ({"file": "a\0b"}, '"a\\u0000b"'),
        ({"file": ["x" * 50]}, ""),
        ({"file": "/a.png"}, "'/a.png'"),
        ({"file": "a/../b"}, "'a/../b'"),
        ({"file": "C:\\a.png"}, "'C:\\a.png'"),
        ({"file": "a\\..\\b"}, "'a\\..\\b'"),
        ({"file": "/" + "y" * 80}, "'/yyyyyyyyyy"),
        ({"file": "a/" + "ß" * 120 + "x"}, "241 240"),
        ({"file": "/".join(["x" * 199] * 10) + "/z"}, "2001 2000"),
    ],
)
def test_names_that_are_none_or_lead_elsewhere_are_refused(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        Fields(entry, "frames[3]").photo("file")
    assert tells(refusal(error).replace("\\", ""), f"frames[3].file: {words}")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (True, "boolean"),
        ("2", "string"),
        (0, "0 1e+30"),
        (-1.5, "-1.5 1e+30"),
        (1e30, "1e+30"),
        (float("nan"), "nan"),
        (10**40, "1e+40 1e+30"),
    ],
)
def test_what_is_no_depth_is_refused(value: object, words: str) -> None:
    with pytest.raises(InputError) as error:
        Fields({"far": value}).depth("far")
    assert refusal(error).startswith("far: ") and tells(refusal(error), words)
