"""The body's material: elasticity and the limits of the strain, also by region."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from .base import Fault, Place, Section, entry, refuse_if
from .strain_limit import BodyKind, StrainLimit, StrainLimits, limit_faults
from .values import PoissonScalar, PositiveScalar, PositiveScalarOrInfinite, Scalar
from .wording import show

_YOUNG = "Young's modulus E"
_STIFFNESS = (
    "A as 3x3 (2D) or 6x6 matrix in Mandel's notation, symmetric and elliptic; 4x4 (rr, zz, hoop, "
    "rz) of an axisymmetric body"
)
_ELASTICITY_CHOICES = (("young", "poisson"), ("lambda", "mu"), ("stiffness",))


class Elasticity(Section):
    """sigma = A eps(u): A isotropic by (E, nu) or by Lame's (lambda, mu), or any Mandel matrix.

    In 2D the body is in plane strain unless material.plane says otherwise. A tensor of numbers must
    be elliptic; expressions are checked when they are evaluated on the mesh.
    """

    young: PositiveScalar | None = entry(1.0, _YOUNG, "stress", scalar=True, optional=True)
    poisson: PoissonScalar | None = entry(0.3, "Poisson's ratio", "1", scalar=True, optional=True)
    lame_lambda: Scalar | None = entry(
        None, "Lame's first parameter, in place of E and nu",
        "stress", alias="lambda", scalar=True, optional=True,
    )  # fmt: skip
    lame_mu: PositiveScalar | None = entry(
        None, "shear modulus, with lambda", "stress", alias="mu", scalar=True, optional=True
    )
    stiffness: tuple[tuple[Scalar, ...], ...] | None = entry(
        None, _STIFFNESS, "stress", scalar=True, optional=True
    )

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

    @model_validator(mode="after")
    def _elliptic(self) -> Elasticity:
        if self.stiffness is not None:
            refuse_if(_stiffness_faults(self.stiffness))
        return self

    def dimension_faults(self, body: BodyKind) -> Iterator[Fault]:
        """Faults that depend on the body: m lambda + 2 mu <= 0, a matrix of another size."""
        if isinstance(self.lame_lambda, float) and isinstance(self.lame_mu, float):
            # With sigma_zz = 0 the inverse of A is positive if it is so in three dimensions.
            number = 3 if body.plane_stress else body.strains
            bulk = number * self.lame_lambda + 2 * self.lame_mu
            if bulk <= 0:
                yield Fault(
                    ("lambda",),
                    f"not elliptic: {number} lambda + 2 mu = {bulk:g} must be > 0 {body}",
                )
        size = body.components
        if self.stiffness is not None and len(self.stiffness) != size:
            given = len(self.stiffness)
            yield Fault(
                ("stiffness",), f"must be {size}x{size} {body} (Mandel), not {given}x{given}"
            )
        elif self.stiffness is not None and body.plane_stress:
            yield Fault(
                ("stiffness",),
                "does not go with material.plane: stress; give the matrix of plane stress itself, "
                "which maps the strains of the plane to its stresses, and leave out material.plane",
            )


def _stiffness_faults(rows: tuple[tuple[float | str, ...], ...]) -> Iterator[Fault]:
    place = ("stiffness",)
    lengths = {len(row) for row in rows}
    if len(rows) not in (3, 4, 6) or lengths != {len(rows)}:
        given = f"rows of the lengths {show([len(row) for row in rows])}" if rows else "nothing"
        yield Fault(place, f"must be a 3x3, 4x4 or 6x6 matrix (a list of rows), not {given}")
        return
    values = np.array([[v if isinstance(v, float) else np.nan for v in row] for row in rows])
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


class Region(Section):
    """The material of a physical group of cells, as far as it differs from ``material``."""

    elasticity: Elasticity | None = entry(
        None, "elasticity tensor A; null: material.elasticity", optional=True
    )
    locking_limit: PositiveScalarOrInfinite | None = entry(
        None, "M of this region; null: as in material", "1", scalar=True, optional=True
    )
    locking: StrainLimits | None = entry(
        None, "limits of the strain in this region, in place of all of material; null: as there",
        optional=True,
    )  # fmt: skip

    @model_validator(mode="after")
    def _check(self) -> Region:
        refuse_if(limit_faults(self.locking or (), self.locking_limit))
        return self

    @property
    def limits(self) -> tuple[StrainLimit, ...] | None:
        """The limits of the strain in this region, None for those of the material."""
        if self.locking_limit is None and self.locking is None:
            return None
        return _limits(self.locking or (), self.locking_limit)


class MaterialParameters(Section):
    """Material (1): sigma in A eps(u) + dI_K(eps(u)), where K is the ball |xi| <= M of the paper.

    With a list of limits K is the intersection of all their sets.
    """

    elasticity: Elasticity = entry(Elasticity(), "elasticity tensor A")
    locking_limit: PositiveScalarOrInfinite = entry(
        np.inf, "M, largest |eps(u)|; .inf: plain elasticity", "1", scalar=True
    )
    locking: StrainLimits = entry(
        (), "limits of the strain, in place of locking_limit; all of them hold"
    )
    plane: Literal["strain", "stress"] = entry(
        "strain",
        "in 2D: plane strain, eps_zz = 0, or plane stress, sigma_zz = 0, where limits are those of "
        "the strain in the plane",
    )
    regions: dict[str, Region] = entry({}, "other materials, by name of the group of cells")

    @model_validator(mode="after")
    def _check(self) -> MaterialParameters:
        refuse_if(limit_faults(self.locking, self.locking_limit))
        return self

    @property
    def limits(self) -> tuple[StrainLimit, ...]:
        """The limits of the strain; ``locking_limit`` is the one of the norm ``strain``."""
        return _limits(self.locking, self.locking_limit)

    def dimension_faults(self, dim: int, axisymmetric: bool = False) -> Iterator[Fault]:
        """The faults of elasticity tensors and limits of the strain for a body."""
        plane_stress = self.plane == "stress"
        if plane_stress and (dim != 2 or axisymmetric):
            where = "axisymmetric bodies" if axisymmetric else "bodies in 3D"
            yield Fault(("plane",), f"stress is for bodies in 2D, not for {where}")
            return
        body = BodyKind(dim, axisymmetric, plane_stress)
        sections: dict[Place, Elasticity | StrainLimit] = {("elasticity",): self.elasticity}
        sections |= {("locking", i): limit for i, limit in enumerate(self.locking)}
        for name, region in self.regions.items():
            if region.elasticity is not None:
                sections["regions", name, "elasticity"] = region.elasticity
            for i, limit in enumerate(region.locking or ()):
                sections["regions", name, "locking", i] = limit
        for place, section in sections.items():
            for fault in section.dimension_faults(body):
                yield Fault((*place, *fault.place), fault.message)


def _limits(limits: tuple[StrainLimit, ...], ball: float | str | None) -> tuple[StrainLimit, ...]:
    if limits or ball is None or ball == np.inf:
        return limits
    return (StrainLimit(norm="strain", at_most=ball),)
