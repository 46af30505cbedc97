import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from api.strict_json import MalformedJson, read_json

JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**17), 10**17)
    | st.floats(allow_nan=False, allow_infinity=False) | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), inner),
)  # fmt: skip


@given(JSON)
def test_whatever_is_json_is_read_as_it_was_written(value):
    assert read_json(json.dumps(value).encode()) == value


@pytest.mark.parametrize(
    "body",
    [
        b"", b" ", b"{", b"{'a': 1}", b'{"a": 1,}', b"[1 2]", b'{"a": 1} x', b"nul", b"01", b"+1", b".5",
        b"1.",
        b"\xff\xfe{\x00}\x00", b"\xef\xbb\xbf{}", b'"\xc3"', b'"\x00"',
        b"NaN", b"[Infinity]", b'{"a": -Infinity}',
        b'{"a": 1, "a": 1}', b'[{"b": {"a": 1, "c": 2, "a": 3}}]',
        b'"\\ud800"', b'{"\\udc00": 1}', b'["\\ud800\\ud800"]',
        b"[" * 200_000 + b"]" * 200_000, b"[" * 200_000, b'{"a":' * 200_000, b"[" * 300 + b"]" * 300,
    ],
)  # fmt: skip
def test_whatever_is_not_json_is_refused(body):
    with pytest.raises(MalformedJson):
        read_json(body)


@pytest.mark.parametrize(
    "digits", [b"1e999", b"-1e999", b"9" * 5000, b"-" + b"9" * 400, b"1" + b"0" * 100_000]
)
def test_a_number_beyond_a_double_becomes_infinite_so_that_its_field_can_be_named(digits):
    assert abs(read_json(digits)) == float("inf")


def test_a_pair_of_surrogates_is_one_character():
    assert read_json(b'"\\ud83d\\ude00"') == "\U0001f600"
