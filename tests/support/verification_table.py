"""The table of docs/verification.md: the computed number, the reference and their difference."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pytest

HEAD = """# Problems with known answers

`make verification` solves problems with a known answer, in closed form or published, and writes
this page. A line shows one quantity of a problem, in the case (mesh, element, material, penalty)
with the largest difference; of many quantities there are the three with the largest differences.
Differences are relative, and absolute where the reference is 0. A rate is the slope of a line
through the logarithms of error and mesh size; its reference is the order in theory. Degree 2 has
order 1 in V where the body locks, which is the difference of 0.5 from the optimal order. The tests
in tests/verification hold the data of each problem and the tolerance of each case.

| problem | quantity | computed | reference | difference |
| --- | --- | --- | --- | --- |
"""
# The most quantities of a problem.
_MOST = 3


@dataclass(frozen=True)
class Row:
    """One number: ``exact`` None where the number is itself an error, which should be zero."""

    id: str
    problem: str
    quantity: str
    computed: float
    exact: float | None

    @property
    def error(self) -> float:
        """The relative error, or the absolute error where the exact value is 0."""
        if self.exact is None or self.exact == 0.0:
            return abs(self.computed)
        return abs(self.computed / self.exact - 1.0)

    def line(self) -> str:
        exact = 0.0 if self.exact is None else self.exact
        numbers = f"{self.computed:.4g} | {exact:.4g} | {self.error:.1e}"
        return f"| {self.id} {self.problem} | {self.quantity} | {numbers} |"


class Rows(list[Row]):
    """The rows that tests have found."""

    def add(
        self,
        id: str,
        problem: str,
        quantity: str,
        computed: float,
        exact: float | None,
        rel: float | None = None,
        abs: float | None = None,
    ) -> None:
        """Add a row, and assert that it is as exact as that, if a tolerance is given."""
        self.append(Row(id, problem, quantity, computed, exact))
        if rel is not None or abs is not None:
            assert computed == pytest.approx(exact or 0.0, rel=rel, abs=abs), quantity


def table_text(rows: Iterable[Row]) -> str:
    """The table as text: of each problem the quantities with the largest errors in any case."""
    worst: dict[str, dict[str, Row]] = {}
    for row in sorted(rows, key=lambda row: int(row.id[1:])):
        shown = worst.setdefault(row.id, {})
        if row.quantity not in shown or row.error > shown[row.quantity].error:
            shown[row.quantity] = row
    text = HEAD
    for shown in worst.values():
        least = sorted((row.error for row in shown.values()), reverse=True)[:_MOST][-1]
        text += "".join(f"{row.line()}\n" for row in shown.values() if row.error >= least)
    return text
