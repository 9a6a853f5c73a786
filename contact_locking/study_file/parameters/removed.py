"""Keys and values that earlier versions had, with what to do instead."""

from __future__ import annotations

#: By the name of a key; the sentence stands in brackets after "unknown key".
KEYS: dict[str, str] = {
    "curved": "all cells have straight sides; take a smaller mesh.h where a side is round",
}

#: By the name of a key and one of its values; the sentence is the whole message.
VALUES: dict[tuple[str, str], str] = {}
