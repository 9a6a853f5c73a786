"""The limits of the strain: each is a ball, a cylinder or a half space, and K is what all allow."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from .base import Fault, Section, entry, refuse_if
from .values import NegativeScalarOrInfinite, PositiveScalarOrInfinite, Scalar
from .wording import show

# Each limit adds integrals to the forms, and compiling long forms takes long.
_MOST_LIMITS = 20
#: The limits that one list has once at most: of two of them the smaller one counts everywhere.
_ONCE = ("strain", "deviator", "volume")
#: The key that a norm needs, by the norm.
_NEEDED = {"direction": "along", "weighted": "matrix"}
_WITH_LOWER_LIMIT = ("volume", "direction")


#: The norms that contain the strain across the plane of a body in two dimensions.
_ACROSS_THE_PLANE = ("deviator", "volume")


@dataclass(frozen=True)
class BodyKind:
    """The body as far as the sizes of tensors depend on it; ``str`` tells it in words."""

    dim: int
    axisymmetric: bool = False
    plane_stress: bool = False

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


class StrainLimit(Section):
    """|eps| <= M, |dev eps| <= M, m <= tr eps <= M, m <= a.eps a <= M, or |C eps| <= M.

    In plane strain tr eps = eps_xx + eps_yy, and dev eps is the deviator of the three-dimensional
    strain with eps_zz = 0. In plane stress the limits are those of the strain in the plane.
    """

    norm: Literal["strain", "deviator", "volume", "direction", "weighted"] = entry(
        ...,
        "what is limited: |eps|, |dev eps|, tr eps, a.eps a along the unit vector a, or |C eps|",
    )
    at_most: PositiveScalarOrInfinite | None = entry(
        None, "upper limit M > 0", "1", scalar=True, optional=True
    )
    at_least: NegativeScalarOrInfinite | None = entry(
        None, "lower limit m < 0 of volume or direction", "1", scalar=True, optional=True
    )
    along: tuple[Scalar, ...] | None = entry(
        None, "direction a, of any length", "1", scalar=True, optional=True
    )
    matrix: tuple[tuple[Scalar, ...], ...] | None = entry(
        None, "C of weighted as 3x3 (2D), 6x6 or 4x4 matrix (axisymmetric), in Mandel's notation",
        "1", scalar=True, optional=True,
    )  # fmt: skip

    @model_validator(mode="after")
    def _check(self) -> StrainLimit:
        refuse_if(self._faults())
        return self

    @property
    def upper(self) -> float | str:
        """The upper limit, inf where there is none."""
        return math.inf if self.at_most is None else self.at_most

    @property
    def lower(self) -> float | str:
        """The lower limit, -inf where there is none."""
        return -math.inf if self.at_least is None else self.at_least

    def _faults(self) -> Iterator[Fault]:
        for norm, key in _NEEDED.items():
            if self.norm == norm and getattr(self, key) is None:
                yield Fault((key,), f"is missing beside norm: {norm}")
            if self.norm != norm and getattr(self, key) is not None:
                yield Fault((key,), f"belongs to norm: {norm}, not to norm: {self.norm}")
        if self.norm in _WITH_LOWER_LIMIT:
            if self.at_most is None and self.at_least is None:
                yield Fault((), "limits nothing: give at_most, at_least or both")
        elif self.at_least is not None:
            yield Fault(
                ("at_least",),
                f"belongs to norm: {' or '.join(_WITH_LOWER_LIMIT)}; a norm is never negative",
            )
        elif self.at_most is None:
            yield Fault(("at_most",), "is missing")
        if self.along is not None and not any(self.along):
            yield Fault(("along",), f"must not be the zero vector, as in {show(self.along)}")
        if self.matrix is not None:
            yield from _matrix_faults(self.matrix)

    def dimension_faults(self, body: BodyKind) -> Iterator[Fault]:
        """A direction or a matrix of another size, or a norm that the body does not have."""
        if self.along is not None and not body.dim <= len(self.along) <= body.strains:
            number = f"{body.dim}" + (" or 3 (r, z, hoop)" if body.axisymmetric else "")
            yield Fault(
                ("along",),
                f"must have {number} components {body}, not {len(self.along)}: {show(self.along)}",
            )
        size = body.components
        if self.matrix is not None and len(self.matrix) != size:
            given = len(self.matrix)
            yield Fault(("matrix",), f"must be {size}x{size} {body} (Mandel), not {given}x{given}")
        if body.plane_stress and self.norm in _ACROSS_THE_PLANE:
            yield Fault(
                ("norm",),
                f"{self.norm} does not go with material.plane: stress: it limits the strain across "
                "the plane as well, which is not known there; take strain, direction or weighted, "
                "the limits of the strain in the plane",
            )


StrainLimits: TypeAlias = Annotated[tuple[StrainLimit, ...], Field(max_length=_MOST_LIMITS)]


def limit_faults(limits: tuple[StrainLimit, ...], ball: float | str | None) -> Iterator[Fault]:
    """The faults of the keys ``locking`` and ``locking_limit`` of one section together."""
    if limits and ball not in (None, math.inf):
        yield Fault(
            ("locking",),
            f"give either locking_limit: {show(ball)} or locking, in which the entry "
            f"{{norm: strain, at_most: {show(ball)}}} means the same",
        )
    for norm, number in Counter(limit.norm for limit in limits).items():
        if norm in _ONCE and number > 1:
            yield Fault(
                ("locking",), f"has {number} entries with norm: {norm}; give one, with the smaller "
                "limit (min(a, b) of two expressions)",
            )  # fmt: skip


def _matrix_faults(rows: tuple[tuple[float | str, ...], ...]) -> Iterator[Fault]:
    lengths = [len(row) for row in rows]
    if len(rows) not in (3, 4, 6) or set(lengths) != {len(rows)}:
        given = f"rows of the lengths {show(lengths)}" if rows else "nothing"
        yield Fault(("matrix",), f"must be a 3x3, 4x4 or 6x6 matrix (a list of rows), not {given}")
    elif all(isinstance(value, float) for row in rows for value in row) and not np.any(rows):
        yield Fault(("matrix",), "is zero and limits nothing")
