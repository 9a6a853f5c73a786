"""Strains of the body that are not elastic: swelling, growth, heat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import Field, Tag

from .base import Fault, Section, entry
from .values import LIST, SECTION, Names, TimedScalar, list_or
from .wording import show


@dataclass(frozen=True)
class BodyKind:
    """The body as far as the sizes of tensors depend on it; ``str`` tells it in words."""

    dim: int
    axisymmetric: bool = False
    plane_stress: bool = False
    elastic_limits: bool = False

    def __str__(self) -> str:
        return "for an axisymmetric body" if self.axisymmetric else f"in {self.dim}D"

    @property
    def strains(self) -> int:
        """The number of normal strains."""
        return 3 if self.axisymmetric else self.dim

    @property
    def components(self) -> int:
        """The number of components of Mandel vectors."""
        return 4 if self.axisymmetric else self.dim * (self.dim + 1) // 2


_MOST_ENTRIES = 50

_Row = Annotated[
    Annotated[tuple[TimedScalar, ...], Tag(LIST)] | Annotated[TimedScalar, Tag(SECTION)],
    list_or(SECTION),
]
#: A number for the strain ``value I``, a list of normal strains, or the rows of a tensor.
Tensor = Annotated[
    Annotated[tuple[_Row, ...], Tag(LIST)] | Annotated[TimedScalar, Tag(SECTION)],
    list_or(SECTION),
]


class Eigenstrain(Section):
    """eps_0 of sigma = A (eps(u) - eps_0): a strain that costs no stress.

    A number is the same strain in all directions, also across the plane of a body in two
    dimensions. A list has the normal strains, and rows those of a symmetric tensor.
    """

    value: Tensor | None = entry(
        None, "eps_0: a number, normal strains, or rows of a tensor", "1", scalar="t", optional=True
    )
    expansion: Tensor | None = entry(
        None, "strain for a unit of temperature, as value", "1/temperature", scalar="t",
        optional=True,
    )  # fmt: skip
    temperature: TimedScalar | None = entry(
        None, "how much warmer than without stress", "temperature", scalar="t", optional=True
    )
    on: Names | None = entry(
        None, "name(s) of groups of cells; null: the whole body", optional=True
    )

    @property
    def tensor(self) -> tuple[str, Any]:
        """The key of the tensor and its value."""
        if self.value is not None:
            return "value", self.value
        return "expansion", self.expansion

    @property
    def is_across(self) -> bool:
        """Whether the strain across the plane of a body in two dimensions differs from zero."""
        _, tensor = self.tensor
        if not isinstance(tensor, tuple):
            return tensor != 0.0
        last = tensor[2] if len(tensor) == 3 else 0.0
        return (last[2] if isinstance(last, tuple) else last) != 0.0

    def _faults(self) -> Iterator[Fault]:
        if (self.value is None) == (self.expansion is None):
            yield Fault((), "give either value, or expansion and temperature")
        elif self.value is not None and self.temperature is not None:
            yield Fault(("temperature",), "belongs to expansion, not to value")
        elif self.expansion is not None and self.temperature is None:
            yield Fault(("temperature",), "is missing beside expansion")
        key, tensor = self.tensor
        if isinstance(tensor, tuple):
            yield from _tensor_faults(key, tensor)

    def dimension_faults(self, body: BodyKind) -> Iterator[Fault]:
        """A list or rows of another size than the body has, and shear that it cannot have."""
        key, tensor = self.tensor
        if not isinstance(tensor, tuple):
            return
        sizes = (3,) if body.axisymmetric else tuple(sorted({body.dim, 3}))
        if len(tensor) not in sizes:
            number = " or ".join(map(str, sizes))
            what = "rows" if isinstance(tensor[0], tuple) else "normal strains"
            order = " (r, z, hoop)" if body.axisymmetric else ""
            yield Fault((key,), f"must have {number} {what}{order} {body}, not {len(tensor)}")
        elif isinstance(tensor[0], tuple) and body.dim == 2 and len(tensor) == 3:
            for i in range(2):
                if tensor[i][2] != 0.0:
                    what = "the hoop" if body.axisymmetric else "the axis across the plane"
                    yield Fault((key, i, 2), f"must be 0 {body}, where nothing shears along {what}")


def _tensor_faults(key: str, tensor: tuple[Any, ...]) -> Iterator[Fault]:
    rows = [row for row in tensor if isinstance(row, tuple)]
    if not tensor or (rows and {len(row) for row in tensor if row in rows} != {len(tensor)}):
        yield Fault((key,), "must be a number, normal strains, or the rows of a square tensor")
    elif rows and len(rows) != len(tensor):
        yield Fault((key,), f"mixes numbers and rows: {show(tensor)}")
    elif rows:
        for i in range(len(tensor)):
            for j in range(i):
                if tensor[i][j] != tensor[j][i]:
                    yield Fault(
                        (key, i, j),
                        f"not symmetric: it is {show(tensor[i][j])}, and row {j + 1}, column "
                        f"{i + 1} is {show(tensor[j][i])}",
                    )


_Several = Annotated[tuple[Eigenstrain, ...], Field(max_length=_MOST_ENTRIES), Tag(LIST)]
Eigenstrains: TypeAlias = Annotated[
    Annotated[Eigenstrain, Tag(SECTION)] | _Several, list_or(SECTION)
]
