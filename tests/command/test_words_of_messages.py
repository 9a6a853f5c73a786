"""Messages are written for people: no list, tuple, number or name as Python would print it."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from test_bad_input import CASES
from test_contact_sections import WRONG as WRONG_SECTIONS
from wrong_values import STUDIES_WRONG, WRONG, nested

from contact_locking import InputError, from_mapping
from contact_locking.study_file.schema import rows

pytestmark = pytest.mark.serial

PYTHON = re.compile(
    r"""\[['"]\w+['"][],] | \(['"][^'"]*['"], | \{['"]   # lists, tuples, sets and mappings of texts
    | \(\d[^()]*,\s*\) | ,\)                          # a tuple of one
    | \bNone\b | \bTrue\b | \bFalse\b | (?<![.\w])nan\b
    | \b(np|numpy|datetime)\. | \b(array|dtype|Decimal|PosixPath)\b
    | <\w+[ .:] | \bclass\b | \b0x[0-9a-f]{6}
    """,
    re.VERBOSE,
)
# What people write in place of a number, a name, a list or a section.
VALUES: tuple[Any, ...] = (
    *("text", "", "top", "left, right", "1,5", "a b", "it's", "x\x07y", "-1"),
    *(0, -1, 1.5, 10**30, math.nan, math.inf, -math.inf, True, False, None),
    *([], ["left", "top"], ["a", 1, None, True], [["a"], ["b"]], [1, 2, 3, 4], [math.nan]),
    *({}, {"left": 1}, {"on": ["a", "b"]}, {1: 2}, [{}], [{"on": "nowhere"}], [None]),
    *(datetime.date(2026, 11, 23), datetime.datetime(2026, 11, 23, 9, 30)),
)


def refusal(data: dict[str, Any]) -> str:
    """The message about a study file with these data, empty if they are good."""
    try:
        from_mapping(data)
    except InputError as error:
        return str(error)
    return ""


def messages() -> Iterator[str]:
    """The messages about every wrong value in every key, and about the mistakes of other tests."""
    for row in rows():
        key = re.sub(r"\.(NAME|N|\d+|\*|<[a-z]+>)(?=\.|$)", ".0", row.key)
        for value in VALUES:
            yield refusal(nested(key, value))
    for key, value in WRONG:
        yield refusal(nested(key, value))
    for study in STUDIES_WRONG:
        yield refusal({"study": study})
    for contact, _ in WRONG_SECTIONS:
        yield refusal({"contact": contact})
    for changes, _ in CASES:
        for key, value in changes.items():
            yield refusal(nested(key, value))


def test_no_message_about_a_study_file_shows_a_value_as_python_prints_it() -> None:
    told = {text for text in messages() if text}
    assert len(told) > 1000
    assert sorted(text for text in told if PYTHON.search(text)) == []
