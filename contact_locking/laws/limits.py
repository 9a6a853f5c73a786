"""Limits of the strain, and the penalties that stand in for limits that are not kept exactly.

K, which the strain stays in, is the intersection of all limits.  UFL is imported where a limit
comes to a mesh, as study files are read without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from contact_locking.values.concept import BodyKind, Concept, Fault, entry
from contact_locking.values.kinds import (
    MandelMatrix,
    NegativeScalarOrInfinite,
    NonNegative,
    OneOf,
    PositiveOrInfinite,
    PositiveScalarOrInfinite,
    ScalarDirection,
)
from contact_locking.values.value import Value, show

# Each limit adds integrals to the forms, and compiling long forms takes long.
_MOST = 20
_UPPER: Any = entry(Value(math.inf), "upper limit M > 0; .inf: none", "1")
_LOWER: Any = entry(Value(-math.inf), "lower limit m < 0; -.inf: none", "1")


class StrainLimit(Concept):
    """A closed convex set of strains with 0 in its inside."""

    #: Whether a body has one at most, as of two of them the smaller one counts everywhere; those of
    #: several regions are then one set.
    once: ClassVar[bool] = True
    #: Whether the strain across the plane of a body in two dimensions is limited as well.
    is_across: ClassVar[bool] = False

    def on(self, points: Any) -> list[Any]:
        """The sets on a mesh; none for a limit that limits nothing; collective.

        ``points`` are :class:`~contact_locking.problem.points.Points`.  Raises InputError for a
        limit that is not positive.
        """
        raise NotImplementedError

    def _faults(self) -> Iterator[Fault]:
        ends = {"at_most", "at_least"} & {*type(self).model_fields}
        if not ends & self.model_fields_set:
            both = len(ends) > 1
            message = "limits nothing: give at_most, at_least or both" if both else "is missing"
            yield Fault(() if both else ("at_most",), message)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if self.is_across and body.strains == 2 and body.plane_stress:
            name = type(self).model_fields["norm"].default
            yield Fault(
                ("norm",),
                f"{name} does not work with plane stress: it limits also the strain across the "
                "plane, which is not known there; use strain, direction or weighted, the limits of "
                "the strain in the plane",
            )


#: One of the subclasses, which a study file has by its ``norm``.
AnyLimit = Annotated[StrainLimit, OneOf("norm")]
StrainLimits = Annotated[tuple[AnyLimit, ...], Field(max_length=_MOST)]


class StrainBall(StrainLimit):
    """``|eps| <= M`` in the Frobenius norm, the set of the paper.

    ``at_most`` is M > 0, without unit: a number, a text with an expression of x, y and z, a
    constant or function of DOLFINx, an expression of UFL, or a function of points (d, k) with
    values (k,); inf where nothing locks.
    """

    at_most: PositiveScalarOrInfinite = _UPPER
    norm: Literal["strain"] = entry("strain", "what is limited: strain: |eps|")

    def on(self, points: Any) -> list[Any]:
        limits = points.positive(self.at_most, "at_most", "the locking limit")
        # The forms have the ball also where nothing locks.
        return points.norm_set("strain", limits, always=True)


class Deviator(StrainLimit):
    """``|dev eps| <= M``: the change of shape is limited.

    In plane strain it is the deviator of the three-dimensional strain with ``eps_zz = 0``.
    """

    at_most: PositiveScalarOrInfinite = _UPPER
    norm: Literal["deviator"] = entry("deviator", "deviator: |dev eps|")

    is_across = True

    def on(self, points: Any) -> list[Any]:
        from contact_locking.laws.body import deviator

        limits = points.positive(self.at_most, "at_most")
        least = math.sqrt(1.0 - points.size / 3.0)
        made = {"linear_map": deviator, "adjoint": deviator, "least": least}
        return points.norm_set("deviator", limits, **made)


class Volume(StrainLimit):
    """``m <= tr eps <= M``: the change of volume is limited.

    ``at_most`` is M > 0, and ``at_least`` is m < 0.  In plane strain ``tr eps = eps_xx + eps_yy``.
    """

    at_most: PositiveScalarOrInfinite = _UPPER
    at_least: NegativeScalarOrInfinite = _LOWER
    norm: Literal["volume"] = entry("volume", "volume: tr eps")

    is_across = True

    def on(self, points: Any) -> list[Any]:
        import ufl

        root = math.sqrt(points.size)
        return points.between(self, "volume", ufl.Identity(points.size) / root, root)


class Direction(StrainLimit):
    """``m <= a . eps a <= M`` for the unit vector a along fibres.

    ``along`` has d components, of any length; that of a body of revolution may have three.  It is
    read once.
    """

    along: ScalarDirection = entry(..., "direction a, of any length", "1")
    at_most: PositiveScalarOrInfinite = _UPPER
    at_least: NegativeScalarOrInfinite = _LOWER
    norm: Literal["direction"] = entry("direction", "direction: a.eps a along the unit vector a")

    once = False

    def on(self, points: Any) -> list[Any]:
        import ufl

        direction = points.function((points.size,))
        sets = points.between(self, points.name, ufl.outer(direction, direction))
        values = points.sampler(self.along, "along", (points.size,))()
        largest = np.abs(values).max(axis=1, initial=0.0)
        is_limited = np.isfinite([index.limits for index in sets]).any(axis=0)
        message = "the direction is the zero vector somewhere"
        points.refuse(is_limited & (largest == 0.0), message, f"{points.root}.along")
        # Scaled first, so that the squares of tiny and huge components are numbers.
        values /= np.where(largest > 0.0, largest, 1.0)[:, None]
        values /= np.maximum(np.linalg.norm(values, axis=1), 0.5)[:, None]
        points.write(direction, values)
        return sets

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if isinstance(self.along, tuple) and not body.dim <= len(self.along) <= body.strains:
            number = f"{body.dim}" + (" or 3 (r, z, hoop)" if body.axisymmetric else "")
            yield Fault(
                ("along",),
                f"must have {number} components {body}, not {len(self.along)}: {show(self.along)}",
            )


class Weighted(StrainLimit):
    """``|C eps| <= M`` for a Mandel matrix C (s, s), which is read once."""

    matrix: MandelMatrix = entry(
        ...,
        "C of weighted as 3x3 (2D), 6x6 or 4x4 matrix (axisymmetric), in Mandel's notation",
        "1",
    )
    at_most: PositiveScalarOrInfinite = _UPPER
    norm: Literal["weighted"] = entry("weighted", "weighted: |C eps|")

    once = False

    def on(self, points: Any) -> list[Any]:
        import ufl

        from contact_locking.laws.body import weighted

        size = len(points.pairs)
        values = points.sampler(self.matrix, "matrix", (size, size))()
        scale = np.abs(values).max(axis=(1, 2), initial=0.0)
        values /= np.where(scale > 0.0, scale, 1.0)[:, None, None]
        singular = np.linalg.svd(values, compute_uv=False).reshape(len(values), size)
        largest = np.where(scale > 0.0, singular[:, 0], 1.0)
        values /= largest[:, None, None]
        matrix = points.function((size, size))
        points.write(matrix, values)
        # A matrix that is zero limits nothing.
        limits = points.positive(self.at_most, "at_most", over=largest * scale)
        relative = np.where(np.isfinite(limits()), singular[:, -1] / largest, 1.0)
        return points.norm_set(
            points.name,
            limits,
            linear_map=partial(weighted, matrix=matrix),
            adjoint=partial(weighted, matrix=ufl.transpose(matrix)),
            least=min(1.0, points.least(relative)),
        )

    def _faults(self) -> Iterator[Fault]:
        yield from super()._faults()
        rows = self.matrix if isinstance(self.matrix, tuple) else ()
        if rows and all(value == 0.0 for row in rows for value in row):
            yield Fault(("matrix",), "is zero and limits nothing")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        yield from size_faults("matrix", self.matrix, body)


def size_faults(key: str, rows: Any, body: BodyKind) -> Iterator[Fault]:
    """The fault of a Mandel matrix of another size than those of a body, if it has one."""
    size = body.components
    if isinstance(rows, tuple) and len(rows) != size:
        matrix_rows = f"{len(rows)}x{len(rows)}"
        yield Fault((key,), f"must be {size}x{size} {body} (Mandel), not {matrix_rows}")


class PenaltyParameters(Concept):
    """n of the locking penalty R_n (23), epsilon of contact and friction (22), (25)."""

    n: PositiveOrInfinite = entry(
        math.inf, "locking penalty; .inf: the variational inequality itself", "stress"
    )
    epsilon: NonNegative | None = entry(
        None,
        "compliance of the foundation, 1/epsilon is the penalty; 0: none; null: 1/n",
        "length/stress",
    )

    @property
    def compliance(self) -> float:
        """``epsilon``, which is ``1/n`` unless it is given."""
        return 1.0 / self.n if self.epsilon is None else self.epsilon


@dataclass(frozen=True)
class Penalty:
    """``n`` penalises locking, ``epsilon`` contact; each regularisation smooths friction.

    ``n`` is a stress in (0, inf], ``epsilon >= 0`` is a length over a stress, and
    ``regularisations`` holds one length >= 0 for each contact.  An infinite n, with zero for the
    other parameters, penalises nothing: the problem is then the variational inequality itself.
    """

    n: float
    epsilon: float
    regularisations: tuple[float, ...]

    def inequality(self) -> Penalty:
        """The parameters that penalise nothing."""
        return Penalty(math.inf, 0.0, (0.0,) * len(self.regularisations))

    @property
    def is_inequality(self) -> bool:
        """Whether nothing is penalised."""
        return self == self.inequality()

    @property
    def is_strict(self) -> bool:
        """Whether no limit of the strain and no gap may be exceeded."""
        return math.isinf(self.n) and self.epsilon == 0.0

    @property
    def is_soft(self) -> bool:
        """Whether every limit of the strain and every gap may be exceeded."""
        return math.isfinite(self.n) and self.epsilon > 0.0

    @property
    def compliance(self) -> float:
        """``1/(2n)``: the strain beyond the locking limit for a unit of locking stress."""
        return 0.5 / self.n
