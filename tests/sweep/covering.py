"""A covering design: few rows of features in which every pair of compatible values occurs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

Row = dict[str, str]
Item = tuple[str, str]
Pair = frozenset[Item]
Features = Mapping[str, Sequence[str]]
Agree = Callable[[Item, Item], bool]

# So many rows are drawn for each row that is kept, the one with the most new pairs.
_DRAWS = 4


def pairs_of(features: Features, agree: Agree) -> set[Pair]:
    """All compatible pairs of values of two features."""
    items = [(name, value) for name, values in features.items() for value in values]
    return {frozenset((a, b)) for a, b in combinations(items, 2) if a[0] != b[0] and agree(a, b)}


def pairs_in(row: Row) -> set[Pair]:
    return {frozenset(pair) for pair in combinations(row.items(), 2)}


def design(features: Features, agree: Agree, seed: int = 0) -> tuple[list[Row], set[Pair]]:
    """Rows of pairwise compatible values, and the pairs that no such row contains.

    Greedy: a row begins with a pair that is missing yet, and takes feature by feature the value
    with the most missing pairs.
    """
    random = np.random.default_rng(seed)
    missing = pairs_of(features, agree)
    rows: list[Row] = []
    out_of_reach: set[Pair] = set()
    while missing:
        wanted = min(missing, key=sorted)
        found = [
            row
            for _ in range(_DRAWS)
            if (row := _grown(dict(wanted), features, agree, missing, random))
        ]
        if not found:
            out_of_reach.add(wanted)
            missing.discard(wanted)
            continue
        best = max(found, key=lambda row: len(pairs_in(row) & missing))
        missing -= pairs_in(best)
        rows.append({name: best[name] for name in features})
    return rows, out_of_reach


def _grown(
    row: Row, features: Features, agree: Agree, missing: set[Pair], random: np.random.Generator
) -> Row | None:
    """The row with a value of every feature; None if some feature has none that is compatible."""
    while len(row) < len(features):
        # A feature without a choice comes next, so that dead ends are rare.
        choices = {
            name: [v for v in values if all(agree((name, v), item) for item in row.items())]
            for name, values in features.items()
            if name not in row
        }
        if not all(choices.values()):
            return None
        tight = [name for name, values in choices.items() if len(values) == 1]
        names = tight or list(choices)
        name = names[int(random.integers(len(names)))]
        gains = [
            sum(frozenset(((name, v), item)) in missing for item in row.items())
            for v in choices[name]
        ]
        most = [v for v, gain in zip(choices[name], gains, strict=True) if gain == max(gains)]
        row[name] = most[int(random.integers(len(most)))]
    return row
