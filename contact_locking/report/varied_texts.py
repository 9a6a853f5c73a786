"""The values of the keys that vary in a study as texts that tell the cases apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from contact_locking.parameters.telling_apart import told_apart
from contact_locking.results.read import Row

from .shown import shown


class VariedTexts:
    """The texts of all values of keys in the rows of a study; ``titles`` names these keys."""

    def __init__(self, rows: Sequence[Row], titles: Mapping[str, str]) -> None:
        self.titles = titles
        self._texts: dict[str, dict[str, str]] = {}
        for key in titles:
            values = [row.get(key) for row in rows]
            self._texts[key] = dict(zip(map(repr, values), told_apart(values, shown), strict=True))

    def of(self, key: str, row: Row) -> str:
        """The text of the value that a row has for a key that varies."""
        return self._texts[key][repr(row.get(key))]

    def all_of(self, key: str) -> list[str]:
        """The texts of a key, each once, in the order of the rows."""
        return list(dict.fromkeys(self._texts[key].values()))
