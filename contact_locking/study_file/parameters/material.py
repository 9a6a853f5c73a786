"""The body's material: elasticity, eigenstrains and limits of the strain, also by region."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, Tag, model_validator

from contact_locking.values.concept import BodyKind, Concept, Fault, Place, entry, refuse_if
from contact_locking.values.kinds import (
    LIST,
    SECTION,
    Names,
    NegativeScalarOrInfinite,
    PoissonScalar,
    PositiveScalar,
    PositiveScalarOrInfinite,
    Scalar,
    ScalarDirection,
    TimedScalar,
    list_or,
)
from contact_locking.values.value import Value
from contact_locking.values.wording import show

_MOST_ENTRIES = 50

_Row = Annotated[
    Annotated[tuple[TimedScalar, ...], Tag(LIST)] | Annotated[TimedScalar, Tag(SECTION)],
    list_or(SECTION),
]
#: A number for the strain ``value I``, a list of normal strains, or the rows of a tensor.
Tensor = Annotated[
    Annotated[tuple[_Row, ...], Tag(LIST)] | Annotated[TimedScalar, Tag(SECTION)], list_or(SECTION)
]


def _square(rows: tuple[tuple[Any, ...], ...]) -> tuple[tuple[Any, ...], ...]:
    lengths = [len(row) for row in rows]
    if len(rows) not in (3, 4, 6) or set(lengths) != {len(rows)}:
        given = f"rows of the lengths {show(lengths)}" if rows else "nothing"
        raise ValueError(f"must be a 3x3, 4x4 or 6x6 matrix (a list of rows), not {given}")
    return rows


MandelMatrix: TypeAlias = Annotated[tuple[tuple[Scalar, ...], ...], AfterValidator(_square)]


class Eigenstrain(Concept):
    """eps_0 of sigma = A (eps(u) - eps_0): a strain that costs no stress.

    A number is the same strain in all directions, also across the plane of a body in two
    dimensions. A list has the normal strains, and rows those of a symmetric tensor.
    """

    value: Tensor | None = entry(None, "eps_0: a number, normal strains, or rows of a tensor", "1")
    expansion: Tensor | None = entry(
        None, "strain for a unit of temperature, as value", "1/temperature"
    )
    temperature: TimedScalar | None = entry(
        None, "how much warmer than without stress", "temperature"
    )
    on: Names | None = entry(None, "name(s) of groups of cells; null: the whole body")

    @property
    def tensor(self) -> tuple[str, Any]:
        """The key of the tensor and its value."""
        if self.value is not None:
            return "value", self.value
        return "expansion", self.expansion

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

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
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
        for j, i in itertools.combinations(range(len(tensor)), 2):
            if tensor[i][j] != tensor[j][i]:
                yield Fault(
                    (key, i, j),
                    f"not symmetric: it is {show(tensor[i][j])}, and row {j + 1}, column {i + 1} "
                    f"is {show(tensor[j][i])}",
                )


_Several = Annotated[tuple[Eigenstrain, ...], Field(max_length=_MOST_ENTRIES), Tag(LIST)]
Eigenstrains: TypeAlias = Annotated[
    Annotated[Eigenstrain, Tag(SECTION)] | _Several, list_or(SECTION)
]


# Each limit adds integrals to the forms, and compiling long forms takes long.
_MOST_LIMITS = 20
#: The limits that one list has once at most: of two of them the smaller one counts everywhere.
_ONCE = ("strain", "deviator", "volume")
#: The key that a norm needs, by the norm.
_NEEDED = {"direction": "along", "weighted": "matrix"}
_WITH_LOWER_LIMIT = ("volume", "direction")


#: The norms that contain the strain across the plane of a body in two dimensions.
_ACROSS_THE_PLANE = ("deviator", "volume")


class StrainLimit(Concept):
    """|eps| <= M, |dev eps| <= M, m <= tr eps <= M, m <= a.eps a <= M, or |C eps| <= M.

    In plane strain tr eps = eps_xx + eps_yy, and dev eps is the deviator of the three-dimensional
    strain with eps_zz = 0. In plane stress the limits are those of the strain in the plane.
    """

    norm: Literal["strain", "deviator", "volume", "direction", "weighted"] = entry(
        ...,
        "what is limited: |eps|, |dev eps|, tr eps, a.eps a along the unit vector a, or |C eps|",
    )
    at_most: PositiveScalarOrInfinite | None = entry(None, "upper limit M > 0", "1")
    at_least: NegativeScalarOrInfinite | None = entry(
        None, "lower limit m < 0 of volume or direction", "1"
    )
    along: ScalarDirection | None = entry(None, "direction a, of any length", "1")
    matrix: MandelMatrix | None = entry(
        None,
        "C of weighted as 3x3 (2D), 6x6 or 4x4 matrix (axisymmetric), in Mandel's notation",
        "1",
    )

    @property
    def upper(self) -> Value:
        """The upper limit, inf where there is none."""
        return Value(math.inf) if self.at_most is None else self.at_most

    @property
    def lower(self) -> Value:
        """The lower limit, -inf where there is none."""
        return Value(-math.inf) if self.at_least is None else self.at_least

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
        given = [value for row in self.matrix or () for value in row]
        if given and all(value == 0.0 for value in given):
            yield Fault(("matrix",), "is zero and limits nothing")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if self.along is not None and not body.dim <= len(self.along) <= body.strains:
            number = f"{body.dim}" + (" or 3 (r, z, hoop)" if body.axisymmetric else "")
            yield Fault(
                ("along",),
                f"must have {number} components {body}, not {len(self.along)}: {show(self.along)}",
            )
        yield from _size_faults("matrix", self.matrix, body)
        if self.norm in _ACROSS_THE_PLANE and body.strains == 2 and body.plane_stress:
            yield Fault(
                ("norm",),
                f"{self.norm} does not go with material.plane: stress: it limits the strain across "
                "the plane as well, which is not known there; take strain, direction or weighted, "
                "the limits of the strain in the plane",
            )


StrainLimits: TypeAlias = Annotated[tuple[StrainLimit, ...], Field(max_length=_MOST_LIMITS)]


def _size_faults(key: str, rows: MandelMatrix | None, body: BodyKind) -> Iterator[Fault]:
    size = body.components
    if rows is not None and len(rows) != size:
        given = f"{len(rows)}x{len(rows)}"
        yield Fault((key,), f"must be {size}x{size} {body} (Mandel), not {given}")


def limit_faults(limits: tuple[StrainLimit, ...], ball: Value | None) -> Iterator[Fault]:
    """The faults of the keys ``locking`` and ``locking_limit`` of one section together."""
    if limits and ball is not None and ball != math.inf:
        yield Fault(
            ("locking",),
            f"give either locking_limit: {show(ball)} or locking, in which the entry "
            f"{{norm: strain, at_most: {show(ball)}}} means the same",
        )
    for norm, number in Counter(limit.norm for limit in limits).items():
        if norm in _ONCE and number > 1:
            yield Fault(
                ("locking",),
                f"has {number} entries with norm: {norm}; give one, with the smaller "
                "limit (min(a, b) of two expressions)",
            )


_YOUNG = "Young's modulus E"
_STIFFNESS = (
    "A as 3x3 (2D) or 6x6 matrix in Mandel's notation, symmetric and elliptic; 4x4 (rr, zz, hoop, "
    "rz) of an axisymmetric body"
)
_ELASTICITY_CHOICES = (("young", "poisson"), ("lambda", "mu"), ("stiffness",))


class Elasticity(Concept):
    """sigma = A eps(u): A isotropic by (E, nu) or by Lame's (lambda, mu), or any Mandel matrix.

    In 2D the body is in plane strain unless material.plane says otherwise. A tensor of numbers must
    be elliptic; expressions are checked when they are evaluated on the mesh.
    """

    young: PositiveScalar | None = entry(Value.of(1.0), _YOUNG, "stress")
    poisson: PoissonScalar | None = entry(Value.of(0.3), "Poisson's ratio", "1")
    lame_lambda: Scalar | None = entry(
        None, "Lame's first parameter, in place of E and nu", "stress", alias="lambda"
    )
    lame_mu: PositiveScalar | None = entry(None, "shear modulus, with lambda", "stress", alias="mu")
    stiffness: MandelMatrix | None = entry(None, _STIFFNESS, "stress")

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, data: Any) -> Any:
        data = {} if data is None else data
        if not isinstance(data, dict):
            return data
        given = {key for key, value in data.items() if value is not None}
        chosen = [choice for choice in _ELASTICITY_CHOICES if given & set(choice)]
        if len(chosen) > 1:
            keys = ", ".join(key for choice in chosen for key in choice if key in given)
            message = f"give young and poisson, or lambda and mu, or stiffness; not {keys} together"
            refuse_if([Fault((), message)])
        if not chosen or chosen[0] == ("young", "poisson"):
            return {key: value for key, value in data.items() if value is not None}
        missing = [key for key in chosen[0] if key not in given]
        refuse_if(Fault((key,), f"is missing beside {chosen[0][0]}") for key in missing)
        return {"young": None, "poisson": None, **data}

    def _faults(self) -> Iterator[Fault]:
        return iter(()) if self.stiffness is None else _stiffness_faults(self.stiffness)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        first, second = self.lame_lambda, self.lame_mu
        if first and second and first.number is not None and second.number is not None:
            # With sigma_zz = 0 the inverse of A is positive if it is so in three dimensions.
            number = 3 if body.plane_stress else body.strains
            bulk = number * first.number + 2 * second.number
            if bulk <= 0:
                yield Fault(
                    ("lambda",),
                    f"not elliptic: {number} lambda + 2 mu = {bulk:g} must be > 0 {body}",
                )
        yield from _size_faults("stiffness", self.stiffness, body)
        if self.stiffness is not None and body.plane_stress:
            yield Fault(
                ("stiffness",),
                "does not go with material.plane: stress; give the matrix of plane stress itself, "
                "which maps the strains of the plane to its stresses, and leave out material.plane",
            )


def _stiffness_faults(rows: MandelMatrix) -> Iterator[Fault]:
    place = ("stiffness",)
    values = np.array([[np.nan if v.number is None else v.number for v in row] for row in rows])
    scale = np.nanmax(np.abs(values), initial=0.0)
    # A difference is not a number if an expression is in it, and is not compared.
    for i, j in np.argwhere(np.triu(np.abs(values - values.T) > 1e-9 * scale)):
        yield Fault(
            place,
            f"not symmetric: row {i + 1}, column {j + 1} is {values[i, j]:g} but "
            f"row {j + 1}, column {i + 1} is {values[j, i]:g}",
        )
        return
    if not np.isnan(values).any():
        smallest = np.linalg.eigvalsh(values / (scale or 1.0))[0] * scale
        if smallest <= 1e-12 * scale:
            yield Fault(
                place, f"not elliptic: its smallest eigenvalue is {smallest:.6g} and must be > 0"
            )


class Region(Concept):
    """The material of a physical group of cells, as far as it differs from ``material``."""

    elasticity: Elasticity | None = entry(None, "elasticity tensor A; null: material.elasticity")
    locking_limit: PositiveScalarOrInfinite | None = entry(
        None, "M of this region; null: as in material", "1"
    )
    locking: StrainLimits | None = entry(
        None, "limits of the strain in this region, in place of all of material; null: as there"
    )

    def _faults(self) -> Iterator[Fault]:
        return limit_faults(self.locking or (), self.locking_limit)

    @property
    def limits(self) -> tuple[StrainLimit, ...] | None:
        """The limits of the strain in this region, None for those of the material."""
        if self.locking_limit is None and self.locking is None:
            return None
        return _limits(self.locking or (), self.locking_limit)


class MaterialParameters(Concept):
    """Material (1): sigma in A eps(u) + dI_K(eps(u)), where K is the ball |xi| <= M of the paper.

    With a list of limits K is the intersection of all their sets.
    """

    elasticity: Elasticity = entry(Elasticity(), "elasticity tensor A")
    locking_limit: PositiveScalarOrInfinite = entry(
        Value(math.inf), "M, largest |eps(u)|; .inf: plain elasticity", "1"
    )
    locking: StrainLimits = entry(
        (), "limits of the strain, in place of locking_limit; all of them hold"
    )
    plane: Literal["strain", "stress"] = entry(
        "strain",
        "in 2D: plane strain, eps_zz = 0, or plane stress, sigma_zz = 0, where limits are those of "
        "the strain in the plane",
    )
    eigenstrain: Eigenstrains = entry(
        (), "strains that are not elastic: one section, or a list of sections, which add up"
    )
    regions: dict[str, Region] = entry({}, "other materials, by name of the group of cells")

    def _faults(self) -> Iterator[Fault]:
        return limit_faults(self.locking, self.locking_limit)

    @property
    def eigenstrains(self) -> list[tuple[Place, Eigenstrain]]:
        """The sections of strains that are not elastic, with their places in the material."""
        if isinstance(self.eigenstrain, tuple):
            return [(("eigenstrain", i), item) for i, item in enumerate(self.eigenstrain)]
        return [(("eigenstrain",), self.eigenstrain)]

    @property
    def limits(self) -> tuple[StrainLimit, ...]:
        """The limits of the strain; ``locking_limit`` is the one of the norm ``strain``."""
        return _limits(self.locking, self.locking_limit)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.plane_stress and (body.dim != 2 or body.axisymmetric):
            where = "axisymmetric bodies" if body.axisymmetric else "bodies in 3D"
            yield Fault(("plane",), f"stress is for bodies in 2D, not for {where}")


def _limits(limits: tuple[StrainLimit, ...], ball: Value | None) -> tuple[StrainLimit, ...]:
    if limits or ball is None or ball == math.inf:
        return limits
    return (StrainLimit(norm="strain", at_most=ball),)
