"""The material as coefficients of the forms: constants for a uniform material, else P0 functions.

P1 strains are constant in a cell: a coefficient that varies in space is evaluated at the midpoint
of each cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from ufl.core.expr import Expr

from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import SMALLEST, parse
from contact_locking.laws import elasticity as law
from contact_locking.parallel import agree
from contact_locking.parameters import Elasticity, MaterialParameters
from contact_locking.problem.domain import Domain
from contact_locking.problem.spaces import strain_space


@dataclass(frozen=True)
class Material:
    """The material on the mesh, for the forms and the certificate.

    ``elastic_stress`` maps a UFL strain to a stress.  ``limit`` is M as a P0 function, inf where
    nothing locks, and ``inverse_limit`` is 1/M.  ``ellipticity`` (alpha) and ``stiffness`` are the
    smallest and the largest eigenvalue of A over the body, and ``young`` is the smallest Young's
    modulus.  ``largest_eigenvalue`` is the P0 function of the largest eigenvalue of A in each cell.
    """

    elastic_stress: Callable[[Expr], Expr]
    limit: fem.Function
    inverse_limit: fem.Function
    ellipticity: float
    stiffness: float
    young: float
    largest_eigenvalue: fem.Function


def build_material(domain: Domain, given: MaterialParameters) -> Material:
    """Evaluate the material on the mesh; collective.

    Raises InputError if A is not symmetric or not elliptic somewhere, and if M is not positive.
    """
    cells = Cells(domain)
    limit, inverse = fem.Function(cells.space), fem.Function(cells.space)
    limit.x.array[:] = np.inf
    for where, value, key in _locking_limits(domain, cells, given):
        limit.x.array[cells.dofs[where]] = cells.evaluate(value, where, key, infinite=True)
        smallest = _minimum(domain, limit.x.array[cells.dofs[where]])
        if not smallest > 0.0:
            raise InputError(f"the locking limit must be positive, it reaches {smallest:g}", key)
        if smallest < SMALLEST:
            raise InputError(
                f"the locking limit must be at least {SMALLEST:g}, it reaches {smallest:g}", key
            )
    inverse.x.array[:] = 1.0 / limit.x.array
    stress, eigenvalues, young, key = _elasticity(domain, cells, given)
    lowest, highest = _eigenvalue_range(domain, eigenvalues, key)
    largest = fem.Function(cells.space)
    largest.x.array[cells.dofs] = eigenvalues.max(axis=0)
    return Material(stress, limit, inverse, lowest, highest, _minimum(domain, young), largest)


class Cells:
    """All local cells (k,) with their midpoints (d, k) and their P0 dofs (k,)."""

    def __init__(self, domain: Domain) -> None:
        index_map = domain.mesh.topology.index_map(domain.dim)
        self._comm = domain.comm
        self.all = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        self.midpoints = dmesh.compute_midpoints(domain.mesh, domain.dim, self.all)
        self.midpoints = self.midpoints[:, : domain.dim].T
        self.space = strain_space(domain.mesh)
        self.dofs = self.space.dofmap.list.reshape(-1)

    def evaluate(
        self, value: float | str, cells: IndexArray, key: str, infinite: bool = False
    ) -> FloatArray:
        """A number or an expression of x, y[, z] at the midpoints of given cells; collective."""
        return evaluate(self._comm, value, self.midpoints[:, cells], key, infinite)


def evaluate(
    comm: MPI.Intracomm, value: float | str, x: FloatArray, key: str, infinite: bool = False
) -> FloatArray:
    """A number or an expression of x, y[, z] at points (d, k), as (k,); collective.

    Raises InputError with the key on all ranks if a value of any rank is NaN, or infinite without
    ``infinite``.
    """
    expression = parse(value, AXES, allow_infinite=infinite)
    places = dict(zip(AXES, x, strict=False))
    result = agree(comm, lambda: with_key(key, lambda: expression.numpy(**places)))
    return np.broadcast_to(np.asarray(result, dtype=float), x.shape[1:]).copy()


def _locking_limits(
    domain: Domain, cells: Cells, given: MaterialParameters
) -> Iterator[tuple[IndexArray, float | str, str]]:
    yield cells.all, given.locking_limit, "material.locking_limit"
    for name, region in given.regions.items():
        if region.locking_limit is not None:
            where = domain.cells(name, f"material.regions.{name}")
            yield where, region.locking_limit, f"material.regions.{name}.locking_limit"


def _elasticities(
    domain: Domain, cells: Cells, given: MaterialParameters
) -> list[tuple[IndexArray, Elasticity, str]]:
    parts: list[tuple[IndexArray, Elasticity, str]] = [
        (cells.all, given.elasticity, "material.elasticity")
    ]
    for name, region in given.regions.items():
        where = domain.cells(name, f"material.regions.{name}")
        if region.elasticity is not None:
            parts.append((where, region.elasticity, f"material.regions.{name}.elasticity"))
    return parts


def _elasticity(
    domain: Domain, cells: Cells, given: MaterialParameters
) -> tuple[Callable[[Expr], Expr], FloatArray, FloatArray, str]:
    """The stress law, the eigenvalues of A (s, k), Young's moduli (k,), and the last key."""
    parts = _elasticities(domain, cells, given)
    if any(elasticity.stiffness is not None for _, elasticity, _ in parts):
        return _anisotropic(domain, cells, parts)
    lame = np.empty((2, len(cells.all)))
    for where, elasticity, key in parts:
        lame[:, where] = _lame(cells, where, elasticity, key)
    eigenvalues = np.array(law.isotropic_eigenvalues(lame[0], lame[1], domain.dim))
    with np.errstate(all="ignore"):  # the eigenvalues tell whether A is elliptic
        young = law.young_from_lame(lame[0], lame[1])
    least = [_minimum(domain, row) for row in lame]
    if len(parts) == 1 and least == [-_minimum(domain, -row) for row in lame]:
        constants = [fem.Constant(domain.mesh, value) for value in least]
        stress = partial(law.isotropic_stress, lame_lambda=constants[0], lame_mu=constants[1])
        return stress, eigenvalues, young, parts[-1][2]
    fields = [fem.Function(cells.space) for _ in range(2)]
    for field, values in zip(fields, lame, strict=True):
        field.x.array[cells.dofs] = values
    stress = partial(law.isotropic_stress, lame_lambda=fields[0], lame_mu=fields[1])
    return stress, eigenvalues, young, parts[-1][2]


def _anisotropic(
    domain: Domain, cells: Cells, parts: list[tuple[IndexArray, Elasticity, str]]
) -> tuple[Callable[[Expr], Expr], FloatArray, FloatArray, str]:
    size = len(law.MANDEL_PAIRS[domain.dim])
    matrices = np.empty((len(cells.all), size, size))
    for where, elasticity, key in parts:
        if elasticity.stiffness is None:
            lame = _lame(cells, where, elasticity, key)
            matrices[where] = law.isotropic_stiffness(lame[0], lame[1], domain.dim)
            continue
        for i, row in enumerate(elasticity.stiffness):
            for j, entry in enumerate(row):
                place = f"{key}.stiffness"
                matrices[where, i, j] = cells.evaluate(entry, where, place)
        part = matrices[where]
        skew = np.abs(part - np.swapaxes(part, 1, 2))
        if -_minimum(domain, -skew) > 1e-10 * -_minimum(domain, -np.abs(part)):
            raise InputError("the stiffness matrix is not symmetric", f"{key}.stiffness")
    eigenvalues = np.asarray(np.linalg.eigvalsh(matrices), dtype=float).T
    with np.errstate(all="ignore"):  # the eigenvalues tell whether A is elliptic
        young = law.mean_young(matrices, domain.dim)
    space = strain_space(domain.mesh, (size, size))
    field = fem.Function(space)
    dofs = space.dofmap.list.reshape(-1)
    field.x.array.reshape(-1, size, size)[dofs] = matrices
    return partial(law.anisotropic_stress, stiffness=field), eigenvalues, young, parts[-1][2]


def _lame(cells: Cells, where: IndexArray, given: Elasticity, key: str) -> FloatArray:
    """Both Lame coefficients (2, k) at the given cells."""
    if given.young is not None and given.poisson is not None:
        young = cells.evaluate(given.young, where, f"{key}.young")
        poisson = cells.evaluate(given.poisson, where, f"{key}.poisson")
        return np.array(law.lame_from_young(young, poisson))
    assert given.lame_lambda is not None and given.lame_mu is not None
    return np.array(
        [
            cells.evaluate(given.lame_lambda, where, f"{key}.lambda"),
            cells.evaluate(given.lame_mu, where, f"{key}.mu"),
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
    local = float(np.min(np.where(np.isnan(values), -np.inf, values), initial=np.inf))
    return float(domain.comm.allreduce(local, op=MPI.MIN))
