"""JSON as RFC 8259 means it: no duplicate names, no NaN, no lone surrogates, no bottomless nesting."""

from __future__ import annotations

import json
from typing import Any, NoReturn

import orjson

__all__ = ["MalformedJson", "read_json", "write_json"]


class MalformedJson(ValueError):
    """A text that is not JSON, or that two readers of JSON could understand differently."""


def read_json(body: bytes) -> Any:
    """The value of a JSON text in UTF-8. Raises MalformedJson.

    A number beyond a double's range is read as infinity, so that its field can be named when it is refused.
    """
    try:
        value = _decoder.decode(body.decode("utf-8"))
        # orjson writes neither lone surrogates nor more than 254 levels of nesting: 1 ms per MB to be sure.
        orjson.dumps(value)
    except MalformedJson:
        raise
    except json.JSONDecodeError as error:
        raise MalformedJson(f"{error.msg} at line {error.lineno}, column {error.colno}.") from None
    except UnicodeDecodeError as error:
        raise MalformedJson(f"Not UTF-8 at byte {error.start}.") from None
    except RecursionError:
        raise MalformedJson("Nested too deep.") from None
    except orjson.JSONEncodeError as error:
        why = "Nested too deep." if "ecursion" in str(error) else "A string holds a lone surrogate."
        raise MalformedJson(why) from None
    return value


def write_json(value: Any, indent: bool = False) -> bytes:
    """A value as JSON; numpy arrays and numbers are welcome. What is not finite becomes null."""
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY | (orjson.OPT_INDENT_2 if indent else 0))


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise MalformedJson(f"The name {twice[:40]!a} appears twice in one object.")
    return value


def _integer(digits: str) -> int | float:
    # Longer ones are doubles to every other reader, and Python refuses to read thousands of digits as an int.
    return int(digits) if len(digits) <= 18 else float(digits)


def _constant(name: str) -> NoReturn:
    raise MalformedJson(f"{name} is not JSON.")


_decoder = json.JSONDecoder(object_pairs_hook=_object, parse_int=_integer, parse_constant=_constant)
