"""The elasticity A on the mesh: its stress in UFL, its eigenvalues at the points of the strains."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms import compute_form_data
from ufl.algorithms.analysis import extract_arguments, extract_type
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.check_arities import ArityMismatch
from ufl.core.expr import Expr

from contact_locking.arrays import SMALLEST, FloatArray
from contact_locking.errors import InputError
from contact_locking.laws import body as law
from contact_locking.laws.material import Eigenstrain, Elasticity
from contact_locking.problem.points import Placed, Points
from contact_locking.problem.strain_sets import Sampler

Stress = Callable[[Expr], Expr]

# Entries below this share of the largest are rounding.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class EigenstrainOnMesh:
    """``sigma = A (eps - eps_0)``: ``stress`` is ``-A eps_0``, ``energy`` is ``A eps_0 : eps_0/2``.

    ``values`` is eps_0 at the points of the strains.  Stress and energy are linear and quadratic in
    the values, unless the stress itself was given.
    """

    values: fem.Function
    stress: Expr
    energy: Expr

    @classmethod
    def of(cls, points: Points, linear: Stress, across: bool) -> EigenstrainOnMesh:
        """eps_0 as (3, 3) tensors; collective.

        With ``across`` eps_0 includes the strain across the plane of a body in plane strain, and
        the law ``linear`` maps three-dimensional tensors.
        """
        values, size = points.function((3, 3)), points.size
        counted: Expr = values
        if size == 2 and not across:
            counted = ufl.as_tensor([[values[i, j] for j in range(2)] for i in range(2)])
        stress = linear(counted)
        in_plane = ufl.as_tensor([[-stress[i, j] for j in range(size)] for i in range(size)])
        return cls(values, in_plane, 0.5 * ufl.inner(stress, counted))


class Material:
    """The elasticity on the mesh, for the forms and the certificate.

    - ``stress``, ``linear``: map a UFL strain to the stress, and to its part A eps
    - ``eigenstrain``: the other part, None without eigenstrains
    - ``ellipticity``, ``stiffness``: alpha and the largest eigenvalue of A over the body
    - ``young``: the smallest Young's modulus
    - ``largest_eigenvalue``: of A at each point, in the space of strains
    - ``in_space``: whether the body is not in plane stress

    The argument ``elasticity`` is A by cells, of which the last one counts; the first is that of
    the whole body.  Constructor, :meth:`refresh` and :meth:`advance` are collective and raise
    InputError if A is not symmetric or not elliptic somewhere.
    """

    ellipticity: float
    stiffness: float
    young: float
    # nu and E at the points of the strains, where they are known.
    _poisson: FloatArray | None = None
    _young: FloatArray | None = None

    def __init__(
        self, points: Points, elasticity: Sequence[Placed], eigenstrains: Sequence[Placed] = ()
    ) -> None:
        self._points, self._key = points, elasticity[-1].key
        whole: Elasticity = elasticity[0].content
        self.in_space = whole.plane != "stress"
        if whole.eigenstrain is not None:
            eigenstrains = [Placed(whole.eigenstrain, f"{self._key}.eigenstrain")]
        self._eigenstrains = eigenstrains
        self.largest_eigenvalue = points.function()
        self.eigenstrain: EigenstrainOnMesh | None = None
        self._pairs, self._size = points.pairs, points.size
        self._own = whole.stress
        self._is_matrix = any(placed.content.stiffness is not None for placed in elasticity)
        if self._own is not None:
            stress = self._own
            initial = stress(ufl.classes.Zero((self._size, self._size)))
            self.stress = self.linear = stress
            if not isinstance(initial, ufl.classes.Zero):
                # UFL cannot see that the initial stress cancels out.
                share = matrix_of(lambda eps: stress(eps) - initial, self._pairs, self._size)
                self.linear = partial(law.anisotropic_stress, stiffness=share)
                values = points.function(initial.ufl_shape)
                energy = 0.5 * ufl.inner(self.linear(values), values)
                self.eigenstrain = EigenstrainOnMesh(values, initial, energy)
                self._present = points.sampler(initial, self._key, initial.ufl_shape)
            matrix = matrix_of(self.linear, self._pairs, self._size)
            self._matrix = points.sampler(matrix, self._key, matrix.ufl_shape)
            self._rotational = points.sampler(whole.rotational or 0.0, self._key)
        elif self._is_matrix:
            shape = (len(self._pairs),) * 2
            self._matrix = points.joined(elasticity, self._matrix_in, shape)
            self._field = points.function(shape)
            self.stress = self.linear = partial(law.anisotropic_stress, stiffness=self._field)
        else:
            self._lame = points.joined(elasticity, _lame_in, (2,))
            in_plane = self._of_plane(self._lame().T)
            data = [
                getattr(placed.content, name)
                for placed in elasticity
                for name in placed.content.lame_names
            ]
            # Data of a script that are uniform now may vary later.
            may_vary = any(value.number is None and value.expression is None for value in data)
            self._lame_fields: list[Any] = []
            for row in in_plane:
                low, high = points.least(row), -points.least(-row)
                is_constant = low == high and not may_vary
                self._lame_fields.append(
                    fem.Constant(points.domain.mesh, low) if is_constant else points.function()
                )
            of_lame = dict(zip(("lame_lambda", "lame_mu"), self._lame_fields, strict=True))
            self.stress = self.linear = partial(law.isotropic_stress, **of_lame)
        if eigenstrains:
            self._present = points.joined(eigenstrains, Eigenstrain.sampler, (3, 3), adds=True)
            across = self.in_space and not self._is_matrix
            eigenstrain = EigenstrainOnMesh.of(points, self.linear, across)
            self.eigenstrain, linear = eigenstrain, self.linear
            self.stress = lambda eps: linear(eps) + eigenstrain.stress
        self.refresh()

    def refresh(self) -> None:
        """Update A and the eigenstrain to the present values of the data; collective."""
        if self._own is None and not self._is_matrix:
            in_space = self._lame().T
            lame = self._of_plane(in_space)
            rows: list[FloatArray] = list(lame)
            for field, row in zip(self._lame_fields, rows, strict=True):
                if isinstance(field, fem.Constant):
                    field.value = self._points.least(row)
                else:
                    self._points.write(field, row)
            with np.errstate(all="ignore"):  # the eigenvalues show whether A is elliptic
                self._young = young = law.young_from_lame(*in_space)
                self._poisson = 0.5 * in_space[0] / (in_space[0] + in_space[1])
            eigenvalues = np.array(law.isotropic_eigenvalues(lame[0], lame[1], self._size))
        else:
            matrices = self._matrix()
            if self._own is not None:
                _require_symmetric(self._points, matrices, self._key)
                rotational = self._points.largest(self._rotational())
                if rotational > _ROUNDING * self._points.largest(matrices):
                    raise InputError(
                        "has an energy of rotations, which no stress has: write it with "
                        "ufl.sym(ufl.grad(u))",
                        self._key,
                    )
            else:
                self._points.write(self._field, matrices)
            eigenvalues = np.asarray(np.linalg.eigvalsh(matrices), dtype=float).T
            with np.errstate(all="ignore"):
                young = law.mean_young(matrices, self._size)
        lowest, highest = self._points.least(eigenvalues), -self._points.least(-eigenvalues)
        message = ""
        if lowest > 0.0 and not np.isfinite(highest):
            message = "the elasticity is not finite: Poisson's ratio must be below 0.5"
        elif not lowest > 0.0:
            message = (
                f"the elasticity is not elliptic: its smallest eigenvalue is {lowest:g}, it must "
                "be positive everywhere"
            )
        elif lowest < SMALLEST:
            message = (
                f"the smallest eigenvalue of the elasticity must be at least {SMALLEST:g}, it is "
                f"{lowest:g}"
            )
        if message:
            raise InputError(message, self._key)
        self.ellipticity, self.stiffness = lowest, highest
        self.young = self._points.least(young)
        self._points.write(self.largest_eigenvalue, eigenvalues.max(axis=0))
        self.advance()

    def advance(self) -> None:
        """Update the eigenstrain to the present time; collective."""
        if self.eigenstrain is None:
            return
        values = self._present()
        if self._own is not None:
            vectors = law.mandel_values(values, self._pairs)
            strains = -np.asarray(np.linalg.solve(self._matrix(), vectors[..., None]))[..., 0]
            values = law.tensor_values(strains, self._pairs, self._size)
        elif self._size == 2 and self._is_matrix and self._points.largest(values[:, 2, 2]) > 0.0:
            raise InputError(
                "the eigenstrain has a part across the plane, whose stress a stiffness matrix of "
                "the plane does not define; give the components in the plane alone, as in "
                "[0.01, 0.01]",
                self._eigenstrains[0].key,
            )
        self._points.write(self.eigenstrain.values, values)

    def across(self, stress: FloatArray) -> FloatArray | None:
        """The stress (k,) across the plane for elastic stresses (k, 2, 2) in the plane.

        It is ``nu (sigma_xx + sigma_yy) - E eps_0,zz`` in plane strain, 0 in plane stress, and None
        if unknown.
        """
        if not self.in_space:
            return np.zeros(len(stress))
        if self._poisson is None or self._young is None:
            return None
        across = self._poisson * np.trace(stress, axis1=1, axis2=2)
        if self.eigenstrain is not None:
            across -= self._young * self._points.values(self.eigenstrain.values)[:, 2, 2]
        return np.asarray(across)

    def _matrix_in(self, data: Elasticity, points: Points) -> Sampler:
        """Mandel matrices (k, s, s)."""
        if data.stiffness is not None:
            shape = (len(self._pairs),) * 2
            check = partial(_require_symmetric, points)
            return points.sampler(data.stiffness, "stiffness", shape, check)
        lame, dim = _lame_in(data, points), points.domain.dim

        def stiffness() -> FloatArray:
            first, second = lame().T
            return law.isotropic_stiffness(first, second, dim, self._pairs)

        return stiffness

    def _of_plane(self, lame: FloatArray) -> FloatArray:
        """Both Lame coefficients (2, k), lambda that of the plane."""
        if self.in_space:
            return lame
        with np.errstate(all="ignore"):
            return np.array([law.plane_stress_lambda(lame[0], lame[1]), lame[1]])


def _lame_in(data: Elasticity, points: Points) -> Sampler:
    """Both Lame coefficients (k, 2) in space."""
    names = data.lame_names
    first, second = (points.sampler(getattr(data, name), data.key_of(name)) for name in names)

    def lame() -> FloatArray:
        values = first(), second()
        with np.errstate(all="ignore"):
            pair = law.lame_from_young(*values) if names[0] == "young" else values
            return np.stack(pair, axis=1)

    return lame


def _require_symmetric(points: Points, matrices: FloatArray, key: str) -> None:
    """Raise InputError for Mandel matrices (k, s, s) that are not symmetric; collective."""
    skew = matrices - np.swapaxes(matrices, 1, 2)
    if points.largest(skew) > _ROUNDING * points.largest(matrices):
        raise InputError("the stiffness matrix is not symmetric", key)


def matrix_of(stress: Stress, pairs: Sequence[tuple[int, int]], size: int) -> Expr:
    """The Mandel matrix (s, s) of a linear map of symmetric (size, size) tensors, in UFL."""
    columns = [law.mandel_vector(stress(_unit(pair, size)), tuple(pairs)) for pair in pairs]
    count = range(len(pairs))
    return ufl.as_matrix([[columns[j][i] for j in count] for i in count])


def _unit(pair: tuple[int, int], size: int) -> Expr:
    """The tensor of the norm 1 with the entries (i, j) and (j, i)."""
    i, j = pair
    entries = np.zeros((size, size))
    entries[i, j] = entries[j, i] = 1.0 / law.mandel_factor(i, j)
    return ufl.as_tensor(entries.tolist())


def split(a: ufl.Form) -> tuple[ufl.Form, ufl.Form | None]:
    """The work of stresses in ``a(u, v)``, and the integrals on facets and of u and v themselves.

    The second form is None without any.  Raises InputError for a form that is not bilinear, and for
    an integral over cells with both.
    """
    try:
        compute_form_data(a)  # with UFL's check of the arguments
        v, u = a.arguments()
    except (ArityMismatch, ValueError):
        raise InputError(
            "must be bilinear: linear in the trial function and in the test function; give the "
            "energy of a nonlinear law as the argument energy",
            "a",
        ) from None
    eye = ufl.Identity(u.ufl_shape[0])
    of_stress, others = [], []
    for integral in a.integrals():
        if integral.integral_type() != "cell":
            others.append(integral)
            continue
        density = _density(integral)
        if not extract_arguments(ufl.replace(density, {ufl.grad(u): eye, ufl.grad(v): eye})):
            of_stress.append(integral)
            continue
        others.append(integral)
        if {gradient.ufl_operands[0] for gradient in extract_type(density, ufl.classes.Grad)} & {
            u,
            v,
        }:
            raise InputError(
                "has strains and the displacement itself in one integral; separate them, as in "
                "inner(sigma(u), eps(v))*dx + k*inner(u, v)*dx",
                "a",
            )
    return ufl.Form(of_stress), ufl.Form(others) if others else None


def elasticity_of(a: ufl.Form) -> Elasticity:
    """The elasticity in a bilinear form ``a(u, v)``: its density at strains of u and v.

    ``a`` is the first form of :func:`split`.  ``rotational`` is the density at rotations, which no
    stress has.
    """
    if a.empty():
        raise InputError("has no energy of strains, such as inner(sigma(u), eps(v))*dx", "a")
    v, u = a.arguments()
    mesh = u.ufl_function_space().mesh
    size = mesh.topology.dim
    densities = []
    for integral in a.integrals():
        number, mark = integral.subdomain_id(), ufl.as_ufl(1.0)
        if number != "everywhere":
            # 1 in the cells of the integral, 0 in the others.
            mark = fem.Function(fem.functionspace(mesh, ("DG", 0)))
            for tag in number if isinstance(number, tuple) else (number,):
                mark.x.array[integral.subdomain_data().find(tag)] = 1.0
        densities.append(mark * _density(integral))

    def density_at(of_u: Expr, of_v: Expr) -> Expr:
        strains = {ufl.grad(u): of_u, ufl.grad(v): of_v}
        return sum(ufl.replace(density, strains) for density in densities)

    pairs = [(i, j) for i in range(size) for j in range(i, size)]

    def stress(eps: Expr) -> Expr:
        units = [_unit(pair, size) for pair in pairs]
        return sum(density_at(eps, unit) * unit for unit in units)

    rotational: Any = 0
    for i, j in itertools.combinations(range(size), 2):
        # A skew tensor of the norm 1.
        turn = np.zeros((size, size))
        turn[j, i], turn[i, j] = np.sqrt(0.5), -np.sqrt(0.5)
        rotational += density_at(*[ufl.as_tensor(turn.tolist())] * 2)
    return Elasticity(stress=stress, rotational=rotational)


def _density(integral: Any) -> Expr:
    """The integrand with gradients of the arguments alone."""
    return apply_derivatives(apply_algebra_lowering(integral.integrand()))
