"""JSON documents parsed: what is none is refused in a few words."""

import json
import re
from typing import Any, TypeAlias

from ..errors import InputError

JsonObject: TypeAlias = dict[str, Any]
"""What `json` makes of an object, or can make one of."""


def parse_object(data: bytes) -> JsonObject:
    """A JSON object; NaN passes, so that the field that holds it is refused by name."""
    return as_object(parse_json(data))


def as_object(document: object) -> JsonObject:
    """The document, which must be a JSON object."""
    if not isinstance(document, dict):
        raise InputError(f"a JSON {kind_of(document)}, expected an object")
    return document


def parse_json(data: bytes) -> Any:
    """Any JSON value."""
    try:
        return json.loads(data)
    except RecursionError:
        raise InputError("JSON nested too deeply") from None
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is not of UTF-8, which JSON is written in: save it as such") from None
    except ValueError as error:
        digits = re.match(r"Exceeds the limit \((\d+) digits\)", str(error))
        fault = f"a number of more than {digits[1]} digits" if digits else f"not JSON ({error})"
        raise InputError(fault if data.strip() else "an empty file, expected JSON") from None


def kind_of(value: object) -> str:
    """JSON's word for a value's type."""
    names = {dict: "object", list: "list", str: "string", bool: "boolean", int: "number", float: "number"}
    return names.get(type(value), "null")
