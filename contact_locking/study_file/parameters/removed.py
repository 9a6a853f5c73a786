"""Keys and values that earlier versions had, with what to do instead."""

from __future__ import annotations

#: By the name of a key; the sentence stands in brackets after "unknown key".
KEYS: dict[str, str] = {
    "animation": "there are no animations: ParaView plays the steps of fields.bp",
}

#: By the name of a key and one of its values; the sentence is the whole message.
VALUES: dict[tuple[str, str], str] = {}
