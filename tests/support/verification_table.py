"""The table of docs/verification.md: computed, exact, error."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

HEAD = """# Problems with known answers

What the verification tests computed, beside the known answer; `make verification` writes this file.
Lengths, stresses and forces are in the consistent units of each problem. A rate is the slope of a
line through the logarithms of error and size over all meshes of the test, beside what theory says.
Errors are relative, and absolute where the answer is 0. The test in the last column says what is
solved and how close it must be.

| id | problem | quantity | computed | known | error | test |
| --- | --- | --- | --- | --- | --- | --- |
"""


@dataclass(frozen=True)
class Row:
    """One number: ``exact`` None where the number is itself an error, which should be zero."""

    id: str
    problem: str
    quantity: str
    computed: float
    exact: float | None
    test: str

    @property
    def error(self) -> str:
        """The relative error, or the absolute error where the exact value is 0."""
        if self.exact is None or self.exact == 0.0:
            return f"{abs(self.computed):.1e}"
        return f"{abs(self.computed / self.exact - 1.0):.1e}"

    def line(self) -> str:
        exact = "0" if self.exact is None else f"{self.exact:.6g}"
        cells = (
            self.id,
            self.problem,
            self.quantity,
            f"{self.computed:.6g}",
            exact,
            self.error,
            self.test,
        )
        return f"| {' | '.join(cells)} |"


def table_text(rows: Iterable[Row]) -> str:
    """The table as text, sorted by the numbers of the problems."""
    ordered = sorted(rows, key=lambda row: int(row.id[1:]))
    return HEAD + "".join(f"{row.line()}\n" for row in ordered)
