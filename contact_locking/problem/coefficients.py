"""The material as coefficients of the forms: constants for a uniform material, else functions.

A coefficient that varies in space is evaluated at the points of the strains.  Affine displacements
have strains that are constant in a cell, and the point is the midpoint of the cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.expressions import SMALLEST, parse
from contact_locking.fem.spaces import Element
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import evaluate
from contact_locking.laws import elasticity as law
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum
from contact_locking.parameters import Elasticity, MaterialParameters, Region

_ADVICE = "refine the mesh there, or let a boundary of material.regions go there"


@dataclass(frozen=True)
class Material:
    """The material on the mesh, for the forms and the certificate.

    ``elastic_stress`` maps a UFL strain to a stress.  ``limit`` is M in the space of strains, inf
    where nothing locks, and ``inverse_limit`` is 1/M.  ``limit_at_peaks`` is M where the strain of
    a cell is largest (`Element.at_peaks`).  ``ellipticity`` (alpha) and ``stiffness`` are the
    smallest and the largest eigenvalue of A over the body, and ``young`` is the smallest Young's
    modulus.  ``largest_eigenvalue`` is the largest eigenvalue of A at each point, in the space of
    strains.
    """

    elastic_stress: Callable[[Expr], Expr]
    limit: fem.Function
    limit_at_peaks: fem.Function
    inverse_limit: fem.Function
    ellipticity: float
    stiffness: float
    young: float
    largest_eigenvalue: fem.Function


def build_material(
    domain: Domain, given: MaterialParameters, element: Element, warnings: list[str]
) -> Material:
    """Evaluate the material at the points of the element's strains; collective.

    Raises InputError if A is not symmetric or not elliptic somewhere, and if M is not positive.
    Adds a warning for data that change sharply inside of cells.
    """
    points = Points(domain, element, warnings)
    limit, inverse = _limit(domain, given, points), fem.Function(points.space)
    at_peaks = limit
    if element.at_peaks is not element:
        at_peaks = _limit(domain, given, Points(domain, element.at_peaks, []))
    inverse.x.array[:] = 1.0 / limit.x.array
    stress, eigenvalues, young, key = _elasticity(domain, points, given)
    lowest, highest = _eigenvalue_range(domain, eigenvalues, key)
    largest = fem.Function(points.space)
    largest.x.array[points.dofs] = eigenvalues.max(axis=0)
    least_young = _minimum(domain, young)
    return Material(stress, limit, at_peaks, inverse, lowest, highest, least_young, largest)


def _limit(domain: Domain, given: MaterialParameters, points: Points) -> fem.Function:
    """M at the given points, inf where nothing locks; collective.

    Raises InputError if M is not positive.
    """
    limit = fem.Function(points.space)
    limit.x.array[:] = np.inf
    for where, value, key in _locking_limits(domain, points, given):
        limit.x.array[points.dofs[where]] = points.evaluate(value, where, key, infinite=True)
        smallest = _minimum(domain, limit.x.array[points.dofs[where]])
        if not smallest > 0.0:
            raise InputError(f"the locking limit must be positive, it reaches {smallest:g}", key)
        if smallest < SMALLEST:
            raise InputError(
                f"the locking limit must be at least {SMALLEST:g}, it reaches {smallest:g}", key
            )
    return limit


class Points:
    """The points of the strains in all local cells, numbered cell by cell.

    ``places`` (d, k) are the coordinates of the points, ``dofs`` (k,) are the degrees of freedom of
    the points in ``space``, and ``all`` (k,) are the numbers of the points.  ``warnings`` get one
    for data with features that the points do not see.
    """

    def __init__(self, domain: Domain, element: Element, warnings: list[str]) -> None:
        self._domain, self._element, self._warnings = domain, element, warnings
        self.places = element.strain_places(domain.mesh)
        self.all = np.arange(self.places.shape[1], dtype=np.int32)
        self.space = element.strain_space(domain.mesh)
        self._in_cell = self.space.dofmap.list.shape[1]
        self.dofs = self.space.dofmap.list.reshape(-1)

    def of(self, cells: IndexArray) -> IndexArray:
        """The numbers of the points in the given cells."""
        return self.all.reshape(-1, self._in_cell)[cells].reshape(-1)

    def tensors(self, shape: tuple[int, ...]) -> fem.Function:
        """A function in the space of strains, with values of the given shape; collective."""
        return fem.Function(self._element.strain_space(self.space.mesh, shape))

    def evaluate(
        self, value: float | str, points: IndexArray, key: str, infinite: bool = False
    ) -> FloatArray:
        """A number or an expression of x, y[, z] at the given points; collective.

        Raises InputError for a value that is not finite, and for a pole in the cells around.
        """
        found = evaluate(self._domain.comm, value, self.places[:, points], key, infinite)
        expression = parse(value, AXES, allow_infinite=infinite)
        if not expression.is_constant:
            cells = np.unique(points // self._in_cell).astype(np.int32)
            inside = Entities.of(self._domain, self._domain.dim, cells)
            self._warnings += features(inside, expression, key, _ADVICE, relative_to="each")
        return found


def _locking_limits(
    domain: Domain, points: Points, given: MaterialParameters
) -> Iterator[tuple[IndexArray, float | str, str]]:
    yield points.all, *_ball(given, "material")
    for name, region in given.regions.items():
        if region.limits is not None:
            where = points.of(domain.cells(name, f"material.regions.{name}"))
            yield where, *_ball(region, f"material.regions.{name}")


def _ball(given: MaterialParameters | Region, place: str) -> tuple[float | str, str]:
    """M of the ball among the limits of a section, inf without a ball, and its key."""
    for index, limit in enumerate(given.locking or ()):
        if limit.norm == "strain":
            return limit.upper, f"{place}.locking.{index}.at_most"
    short = given.locking_limit
    return np.inf if short is None else short, f"{place}.locking_limit"


def _elasticities(
    domain: Domain, points: Points, given: MaterialParameters
) -> list[tuple[IndexArray, Elasticity, str]]:
    parts: list[tuple[IndexArray, Elasticity, str]] = [
        (points.all, given.elasticity, "material.elasticity")
    ]
    for name, region in given.regions.items():
        where = points.of(domain.cells(name, f"material.regions.{name}"))
        if region.elasticity is not None:
            parts.append((where, region.elasticity, f"material.regions.{name}.elasticity"))
    return parts


def _elasticity(
    domain: Domain, points: Points, given: MaterialParameters
) -> tuple[Callable[[Expr], Expr], FloatArray, FloatArray, str]:
    """The stress law, the eigenvalues of A (s, k), Young's moduli (k,), and the last key."""
    parts = _elasticities(domain, points, given)
    if any(elasticity.stiffness is not None for _, elasticity, _ in parts):
        return _anisotropic(domain, points, parts)
    lame = np.empty((2, len(points.all)))
    for where, elasticity, key in parts:
        lame[:, where] = _lame(points, where, elasticity, key)
    with np.errstate(all="ignore"):  # the eigenvalues tell whether A is elliptic
        young = law.young_from_lame(lame[0], lame[1])
        if given.plane == "stress":
            lame[0] = law.plane_stress_lambda(lame[0], lame[1])
    size = domain.kinematics.tensor_size(domain.dim)
    eigenvalues = np.array(law.isotropic_eigenvalues(lame[0], lame[1], size))
    least = [_minimum(domain, row) for row in lame]
    if len(parts) == 1 and least == [-_minimum(domain, -row) for row in lame]:
        constants = [fem.Constant(domain.mesh, value) for value in least]
        stress = partial(law.isotropic_stress, lame_lambda=constants[0], lame_mu=constants[1])
        return stress, eigenvalues, young, parts[-1][2]
    fields = [fem.Function(points.space) for _ in range(2)]
    for field, values in zip(fields, lame, strict=True):
        field.x.array[points.dofs] = values
    stress = partial(law.isotropic_stress, lame_lambda=fields[0], lame_mu=fields[1])
    return stress, eigenvalues, young, parts[-1][2]


def _anisotropic(
    domain: Domain, points: Points, parts: list[tuple[IndexArray, Elasticity, str]]
) -> tuple[Callable[[Expr], Expr], FloatArray, FloatArray, str]:
    pairs = domain.kinematics.mandel_pairs(domain.dim)
    size = len(pairs)
    matrices = np.empty((len(points.all), size, size))
    for where, elasticity, key in parts:
        if elasticity.stiffness is None:
            lame = _lame(points, where, elasticity, key)
            matrices[where] = law.isotropic_stiffness(lame[0], lame[1], domain.dim, pairs)
            continue
        for i, row in enumerate(elasticity.stiffness):
            for j, entry in enumerate(row):
                place = f"{key}.stiffness"
                matrices[where, i, j] = points.evaluate(entry, where, place)
        part = matrices[where]
        skew = np.abs(part - np.swapaxes(part, 1, 2))
        if -_minimum(domain, -skew) > 1e-10 * -_minimum(domain, -np.abs(part)):
            raise InputError("the stiffness matrix is not symmetric", f"{key}.stiffness")
    eigenvalues = np.asarray(np.linalg.eigvalsh(matrices), dtype=float).T
    with np.errstate(all="ignore"):  # the eigenvalues tell whether A is elliptic
        young = law.mean_young(matrices, domain.kinematics.tensor_size(domain.dim))
    field = points.tensors((size, size))
    dofs = field.function_space.dofmap.list.reshape(-1)
    field.x.array.reshape(-1, size, size)[dofs] = matrices
    return partial(law.anisotropic_stress, stiffness=field), eigenvalues, young, parts[-1][2]


def _lame(points: Points, where: IndexArray, given: Elasticity, key: str) -> FloatArray:
    """Both Lame coefficients (2, k) at the given points."""
    if given.young is not None and given.poisson is not None:
        young = points.evaluate(given.young, where, f"{key}.young")
        poisson = points.evaluate(given.poisson, where, f"{key}.poisson")
        return np.array(law.lame_from_young(young, poisson))
    assert given.lame_lambda is not None and given.lame_mu is not None
    return np.array(
        [
            points.evaluate(given.lame_lambda, where, f"{key}.lambda"),
            points.evaluate(given.lame_mu, where, f"{key}.mu"),
        ]
    )


def _eigenvalue_range(domain: Domain, eigenvalues: FloatArray, key: str) -> tuple[float, float]:
    lowest, highest = _minimum(domain, eigenvalues), -_minimum(domain, -eigenvalues)
    if not lowest > 0.0 or not np.isfinite(highest):
        raise InputError(
            f"the elasticity is not elliptic: its smallest eigenvalue is {lowest:g}, it must be "
            "positive everywhere",
            key,
        )
    if lowest < SMALLEST:
        raise InputError(
            f"the smallest eigenvalue of the elasticity must be at least {SMALLEST:g}, it is "
            f"{lowest:g}",
            key,
        )
    return lowest, highest


def _minimum(domain: Domain, values: FloatArray) -> float:
    """The minimum over all ranks; NaN counts as -inf; collective."""
    return minimum(domain.comm, np.where(np.isnan(values), -np.inf, values))
