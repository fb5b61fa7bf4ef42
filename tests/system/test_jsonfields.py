"""Fields of JSON documents: what is accepted up to its limits, and what is refused in which words."""

from __future__ import annotations

import json
from typing import Any

import pytest
from scenes import tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.jsonfields import depth, frame_entries, parse_object, photo_name


def refusal(error: pytest.ExceptionInfo[InputError]) -> str:
    return str(error.value)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b" \n", "an empty file, expected JSON"),
        (b"[1,", "not JSON (Expecting value: line 1 column 4 (char 3))"),
        (b"[" * 100_000, "JSON nested too deeply"),
        (b"1" * 5000, "a number of more than 4300 digits"),
        (b"[2]", "a JSON list, expected an object with frames"),
        (b"null", "a JSON null, expected an object with frames"),
    ],
)
def test_documents_that_are_no_object_are_refused(data: bytes, words: str) -> None:
    with pytest.raises(InputError) as error:
        parse_object(data)
    assert tells(refusal(error), words)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({}, "frames: missing, expected a list of at least one frame"),
        ({"frames": []}, "frames: empty, expected a list of at least one frame"),
        ({"frames": None}, "frames: a JSON null, expected a list of at least one frame"),
        ({"frames": {"0": {}}}, "frames: a JSON object, expected a list of at least one frame"),
        ({"frames": [{}, {}, 7]}, "frames[2]: a JSON number, expected an object"),
    ],
)
def test_frames_that_are_no_list_of_objects_are_refused(document: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        frame_entries(document)
    assert tells(refusal(error), words)


ACCEPTED = ["a.png", "sub/a.png", "..a/b..png", "ß" * 120, "/".join(["x" * 199] * 10)]


@pytest.mark.parametrize("name", [*ACCEPTED, "x" * 240])
def test_names_inside_the_folder_are_taken_as_they_are(name: str) -> None:
    assert photo_name(3, {"file": name}) == name
    assert photo_name(3, {"photo": name, "file": 1}, "photo") == name


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({}, "missing, expected the name of a photo"),
        ({"file": 7}, "7, expected the name of a photo"),
        ({"file": ""}, '"", expected the name of a photo'),
        ({"file": "a\0b"}, '"a\\u0000b", expected the name of a photo'),
        ({"file": ["x" * 50]}, json.dumps(["x" * 50])[:40] + ", expected the name of a photo"),
        ({"file": "/a.png"}, "'/a.png' leaves the scene's folder, expected a path inside it"),
        ({"file": "a/../b"}, "'a/../b' leaves the scene's folder, expected a path inside it"),
        ({"file": "C:\\a.png"}, "'C:\\a.png' leaves the scene's folder, expected a path inside it"),
        ({"file": "a\\..\\b"}, "'a\\..\\b' leaves the scene's folder, expected a path inside it"),
        ({"file": "/" + "y" * 80}, "'/" + "y" * 59 + "' leaves the scene's folder, expected a path inside it"),
        (
            {"file": "a/" + "ß" * 120 + "x"},
            "a path of 123 characters, its longest name of 241 bytes, accepted are 2000 and 240",
        ),
        (
            {"file": "/".join(["x" * 199] * 10) + "/z"},
            "a path of 2001 characters, its longest name of 199 bytes, accepted are 2000 and 240",
        ),
    ],
)
def test_names_that_are_none_or_lead_elsewhere_are_refused(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        photo_name(3, entry)
    assert tells(refusal(error).replace("\\", ""), f"frames[3].file: {words}")


def test_depths_are_numbers_above_zero_and_below_what_float32_can_multiply() -> None:
    assert depth({}, "near") is None and depth({"near": None}, "near") is None
    found = depth({"near": 2, "far": 9.9e29}, "near")
    assert found == 2.0 and isinstance(found, float)
    assert depth({"far": 9.9e29}, "far") == 9.9e29 and depth({"near": 1e-30}, "near") == 1e-30


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (True, "a JSON boolean, expected a depth > 0"),
        ("2", "a JSON string, expected a depth > 0"),
        (0, "0, expected a depth > 0 and below 1e+30"),
        (-1.5, "-1.5, expected a depth > 0 and below 1e+30"),
        (1e30, "1e+30, expected a depth > 0 and below 1e+30"),
        (float("nan"), "nan, expected a depth > 0 and below 1e+30"),
        (10**40, "1" + "0" * 19 + ", expected a depth > 0 and below 1e+30"),
    ],
)
def test_what_is_no_depth_is_refused(value: object, words: str) -> None:
    with pytest.raises(InputError) as error:
        depth({"far": value}, "far")
    assert refusal(error).startswith("far: ") and tells(refusal(error), words)
