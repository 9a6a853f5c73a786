"""The body's material: elasticity, eigenstrains and limits of the strain, also by region."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from keyword import iskeyword
from typing import Annotated, Any, Literal

from pydantic import Field

from contact_locking.expressions import CONSTANTS, FUNCTIONS, POSITION, TIME
from contact_locking.laws.limits import StrainBall, StrainLimit, StrainLimits
from contact_locking.laws.material import Eigenstrain, Eigenstrains, Elasticity
from contact_locking.supports.support import (
    BodyForce,
    Displacement,
    Load,
    Pressure,
    Spring,
    Support,
    TotalForce,
    Traction,
)
from contact_locking.values.concept import (
    BodyKind,
    Concept,
    Fault,
    Place,
    dotted,
    entry,
    leaves,
    place_of,
)
from contact_locking.values.kinds import PositiveScalarOrInfinite, TimedVector
from contact_locking.values.value import Value, show


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
        limits, ball = self.locking or (), self.locking_limit
        if limits and ball is not None and ball != math.inf:
            yield Fault(
                ("locking",),
                f"give either locking_limit: {show(ball)} or locking, in which the entry "
                f"{{norm: strain, at_most: {show(ball)}}} means the same",
            )
        for kind, number in Counter(type(limit) for limit in limits).items():
            if kind.once and number > 1:
                yield Fault(
                    ("locking",),
                    f"has {number} entries with norm: {kind.model_fields['norm'].default}; give "
                    "one, with the smaller limit (min(a, b) of two expressions)",
                )

    def limits(self) -> list[tuple[Place, StrainLimit]] | None:
        """The limits of the strain with their places, None for those of the material.

        ``locking_limit`` is the one of the norm ``strain``.
        """
        if self.locking:
            return [(("locking", index), limit) for index, limit in enumerate(self.locking)]
        if self.locking_limit is None:
            return None if self.locking is None else []
        return [(("locking_limit",), StrainBall(self.locking_limit))]


class MaterialParameters(Region):
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

    @property
    def eigenstrains(self) -> list[tuple[Place, Eigenstrain]]:
        """The sections of strains that are not elastic, with their places in the material."""
        if isinstance(self.eigenstrain, tuple):
            return [(("eigenstrain", i), section) for i, section in enumerate(self.eigenstrain)]
        return [(("eigenstrain",), self.eigenstrain)]

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.plane_stress and (body.dim != 2 or body.axisymmetric):
            where = "axisymmetric bodies" if body.axisymmetric else "bodies in 3D"
            yield Fault(("plane",), f"stress is for bodies in 2D, not for {where}")


# All tractions, pressures and forces are compiled into one form, which takes seconds for 200 of
# them and fails for some 2000.
_MOST_TRACTIONS = 200


class LoadParameters(Concept):
    """Body force f0, tractions g, pressures, prescribed displacements and supports, (2)-(4)."""

    body_force: TimedVector | None = entry(None, "components of f0; null: none", "force/volume")
    tractions: Annotated[tuple[Traction, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their g"
    )
    pressures: Annotated[tuple[Pressure, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their pressure; several loads on one part add up"
    )
    forces: Annotated[tuple[TotalForce, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with the total of their tractions, which are spread evenly"
    )
    displacements: tuple[Displacement, ...] = entry((), "parts of Gamma_D with their u")
    supports: tuple[Support, ...] = entry(
        (), "parts of Gamma_D that are held along their normal or along a given direction"
    )

    springs: Annotated[tuple[Spring, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of the boundary on springs, which hold the body"
    )

    def of(self, *kinds: str) -> list[Any]:
        """The entries of some kinds, each with its key."""
        return [
            concept.model_copy(update={"at": dotted("loads", kind, number)})
            for kind in kinds
            for number, concept in enumerate(getattr(self, kind))
        ]

    @property
    def acting(self) -> list[Load]:
        """The loads, each with its key."""
        force = self.body_force
        whole = [] if force is None else [BodyForce(force, at="loads.body_force")]
        return [*whole, *self.of("forces", "tractions", "pressures")]

    @property
    def held(self) -> list[Support | Displacement]:
        """The prescribed displacements, each with its key."""
        return self.of("supports", "displacements")

    def numbers(self) -> Iterator[tuple[str, Value]]:
        """The key and the number or expression of each component that loads the body."""
        for load in (*self.acting, *self.held):
            for place, value in leaves(load.value, place_of((), load, "value")):
                if value is not None:
                    yield dotted(load.key, *place), value


#: Names that a table may not have.
_TAKEN = {*POSITION, TIME, "s", "inf", *CONSTANTS, *FUNCTIONS}
_MOST_TABLES = 50


def name_faults(names: Iterable[str], what: str) -> Iterator[Fault]:
    """The names of tables or numbers, in words ``what``, that expressions cannot use."""
    names = list(names)
    if len(names) > _MOST_TABLES:
        yield Fault((), f"has {len(names)} {what}; at most {_MOST_TABLES} are allowed")
    for name in names:
        if not (name.isascii() and name.isidentifier()) or iskeyword(name):
            yield Fault((name,), "is not a valid name in expressions; use letters, digits and _")
        elif name in _TAKEN:
            yield Fault((name,), "is already a name in expressions; use another one")
