"""The constants of the theorems for the given data, and the verdict on uniqueness.

If ``kappa = c rho`` is below 1, no other displacement solves the problem on this mesh.
``c = max |v_tau| / |v|_a`` is over the displacements v that are zero on Gamma_D, and
``rho = max |w_g|_a / |g|`` over the values g at the nodes where friction acts, with the norms on
Gamma_C by the weights of the nodes.  w_g has ``w_nu = R* (mu g)`` and ``w_tau = 0`` on Gamma_C, is
zero on Gamma_D and in all cells that can lock, and has the least elastic energy of such fields.
The proof is in docs/notes/bounds.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.certificate.penalty_error import (
    EllipticProblem,
    NotApplicable,
    on_contacts,
    with_contacts_fixed,
)
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import raise_callback_error
from contact_locking.fem.compiled import JointForm
from contact_locking.fem.contact_operator import PointStiffness
from contact_locking.fem.spaces import make_nodal
from contact_locking.findings import Finding
from contact_locking.mesh.distribution import marked
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.supports.conditions import Constraints
from contact_locking.theory.other_solutions import without_friction

# A condition that holds more of a unit normal than this holds more than rounding.
_OBLIQUE = 1e-9
# The share that two eigenvalues to a relative 1e-6 may lack, with room.
_MARGIN = 1e-4
# mu(x, s) is sampled at the slip 0, and from this share of the extent of the body to the extent.
_LEAST_SLIP = 1e-8
_SLIPS = 400
# The verdicts on uniqueness where there is friction.
BY_KAPPA = "unique on this mesh"
SAMPLED = "covered for the discrete problem, by sampled constants"
UNKNOWN = "not known"


def kappa(state: SolvedState, is_asked: bool) -> tuple[float, float]:
    """The constants c and rho of all contacts together, by two eigenvalue problems; collective.

    Both come from below, to the accuracy of the eigenvalue solver.  Raises NotApplicable with the
    hypothesis of the proof that fails, and if nobody asks.
    """
    require_coulomb(state)
    problem = state.problem
    if problem.data.own_energy is not None:
        raise NotApplicable("the body has a user-defined energy")
    if problem.data.is_paired:
        raise NotApplicable("two bodies touch")
    require_held(state)
    rubbing = [contact for contact in problem.contacts if not contact.friction.frictionless]
    if not rubbing:
        raise NotApplicable("there is no friction")
    if any(contact.friction.depends_on_slip for contact in rubbing):
        raise NotApplicable("the friction coefficient depends on the slip")
    constraints = _constraints_of_lifts(state, rubbing)
    if not is_asked:
        raise NotApplicable("certificate.constants is false")
    slips = []
    for contact in rubbing:
        across = np.eye(state.dim) - np.einsum("ki,kj->kij", contact.normals, contact.normals)
        slips.append((contact.surface, across))
    trace = trace_norm(state, state.system.bilinear, slips)
    return trace, _lift_constant(state, rubbing, constraints)


def require_coulomb(state: SolvedState) -> None:
    """Raise NotApplicable unless friction is Coulomb's on foundations in a known place."""
    bounds = [contact.friction for contact in state.problem.contacts]
    if state.problem.data.tools:
        raise NotApplicable(
            "forces decide where a foundation is, and the slip is relative to its unknown travel"
        )
    if not all(bound.is_coulomb for bound in bounds):
        raise NotApplicable("the friction bound is user-defined")


def _constraints_of_lifts(state: SolvedState, rubbing: list[NodalContact]) -> Constraints:
    """The conditions, and those that hold Gamma_C and the cells that can lock; collective.

    Raises NotApplicable where a w_g is no displacement of the mesh.
    """
    constraints, space = state.problem.constraints, state.problem.u.function_space
    contacts, points = state.problem.contacts, state.points
    free = [np.repeat(each.free[:, None].astype(float), state.dim, axis=1) for each in contacts]
    acting = on_contacts(space, [each.surface for each in contacts], free).x.array
    limits = [points.by_cell(np.isfinite(each.limit)).any(axis=1) for each in points.sets]
    cells = np.flatnonzero(np.any(limits, axis=0))
    can_lock = marked(space.dofmap.index_map, space.dofmap.list[cells])
    locks = np.repeat(can_lock.astype(float), state.dim)
    if on_any_rank(state.comm, acting > 1.0):
        raise NotApplicable("friction or pressure of two contacts acts at one node")
    if on_any_rank(state.comm, (acting > 0.0) & (locks > 0.0)):
        raise NotApplicable("the body can lock next to Gamma_C")
    for contact in rubbing:
        normals = contact.surface.vector_function(contact.normals * contact.free[:, None])
        held = normals.x.array - constraints.free_part(normals.x.array)
        if on_any_rank(state.comm, np.abs(held) > _OBLIQUE):
            raise NotApplicable("a displacement condition holds an oblique direction")
    return with_contacts_fixed(state, locks)


def _lift_constant(
    state: SolvedState, rubbing: list[NodalContact], constraints: Constraints
) -> float:
    """rho, over the values g at the owned nodes of the contacts ``rubbing``; collective."""
    space, surfaces = state.problem.u.function_space, [contact.surface for contact in rubbing]
    lift = fem.Function(space)
    form = JointForm(ufl.action(state.system.bilinear, lift))
    coefficients = [each.friction.coefficient(np.zeros(len(each.free))) for each in rubbing]
    roots = [np.sqrt(contact.surface.weights[contact.free]) for contact in rubbing]
    root, ends = np.concatenate(roots), np.cumsum([len(values) for values in roots])[:-1]

    def pushed(parts: list[FloatArray]) -> fem.Function:
        """``R* (mu g) nu`` on Gamma_C for g at the nodes where friction acts."""
        values = []
        for contact, mu, pushes in zip(rubbing, coefficients, parts, strict=True):
            g = np.zeros(len(mu))
            g[contact.free] = pushes
            along = contact.rubbing(contact.friction.smoothing.adjoint(mu * g))
            values.append(along[:, None] * contact.normals)
        field = on_contacts(space, surfaces, values)
        make_nodal(field, [surface.controls for surface in surfaces])
        return field

    def carried() -> list[FloatArray]:
        """``mu R s`` where friction acts, with the normal stresses s of w_g."""
        forces = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)
        form.assemble_vector(forces)
        nodal, stresses = forces.array.reshape(-1, state.dim), []
        for contact, mu in zip(rubbing, coefficients, strict=True):
            surface = contact.surface
            limited = surface.controls.forces(nodal[surface.blocks])
            normal = np.sum(limited * contact.normals, axis=1)
            stress = contact.acting(normal / surface.weights)
            stresses.append((mu * contact.friction.smoothing.apply(stress))[contact.free])
        return stresses

    with closing(EllipticProblem(state, state.system.bilinear, constraints)) as problem:

        def apply(values: FloatArray) -> FloatArray:
            parts = np.split(values / root, ends)
            lift.x.array[:] = problem.solve(None, pushed(parts)).x.array
            return root * np.concatenate(carried())

        return math.sqrt(largest_eigenvalue(state.comm, len(root), apply))


def constants(state: SolvedState, is_asked: bool) -> dict[str, Any]:
    """``alpha``, ``c_0``, ``mu*``, ``L_mu``, ``|R|`` and the verdict on uniqueness; collective.

    c_0 takes an eigenproblem, as long as one or two elastic solves; None unless ``is_asked``.
    """
    numbers: dict[str, Any] = {"alpha": state.problem.material.ellipticity}
    bounds = [contact.friction for contact in state.problem.contacts]
    if bounds:
        try:
            numbers["c_0"] = _trace_constant(state, is_asked)
        except NotApplicable as failure:
            numbers |= {"c_0": None, "c_0_reason": str(failure)}
        numbers |= _coefficient_range(state)
        numbers["smoothing_norm"] = max(bound.smoothing.norm() for bound in bounds)
    if all(bound.frictionless for bound in bounds):
        return numbers | {"uniqueness": without_friction(state)}
    report = _uniqueness(state, numbers, is_asked) | {"contraction": state.report.contraction}
    return numbers | {"uniqueness": report}


def _coefficient_range(state: SolvedState) -> dict[str, Any]:
    """mu* and L_mu over all contacts, stated by the friction laws or sampled; collective.

    The samples are at the nodes of Gamma_C, as in the discrete problem, and at slips up to the
    extent of the body.  Samples prove nothing, except for a mu that does not depend on s.
    """
    ranges, comm, all_exact = [], state.comm, True
    for contact in state.problem.contacts:
        law = contact.friction.law
        most, lipschitz = law.largest, law.lipschitz
        all_exact &= lipschitz is not None and (most is not None or lipschitz == 0.0)
        if most is None or lipschitz is None:
            shares = np.concatenate([[0.0], np.geomspace(_LEAST_SLIP, 1.0, _SLIPS)])
            slips = (shares[:1] if lipschitz == 0.0 else shares) * state.target.length
            everywhere = np.ones(len(contact.free))
            values = np.stack([contact.friction.coefficient(slip * everywhere) for slip in slips])
            steps = np.abs(np.diff(values, axis=0)) / np.diff(slips)[:, None]
            most = maximum(comm, values) if most is None else most
            lipschitz = maximum(comm, steps) if lipschitz is None else lipschitz
        ranges.append((most, lipschitz))
    largest, steepest = np.max(ranges, axis=0)
    return {
        "friction_coefficient": float(largest),
        "friction_lipschitz": float(steepest),
        "friction_constants": "exact" if all_exact else "sampled",
    }


def _trace_constant(state: SolvedState, is_asked: bool) -> float:
    """``c_0 = max |v|_{L2(Gamma_C)}/|v|_V`` over the discrete fields (11); collective.

    ``c_0^2`` is the largest eigenvalue of ``int v . w = lambda (v, w)_V``.  The integral over
    Gamma_C is a sum over the nodes with the nodal weights, as in the discrete problem; for affine
    displacements the sum is never less than the exact integral, by convexity.  The result is not an
    upper bound of the constant in (11): the eigenvalue solver approaches from below, and V has more
    fields.
    """
    require_held(state)
    if state.problem.data.is_paired:
        raise NotApplicable("two bodies touch, and c_0 is for traces of one body")
    if not is_asked:
        raise NotApplicable("skipped: certificate.constants is false")
    surfaces = [contact.surface for contact in state.problem.contacts]
    wholes = [np.tile(np.eye(state.dim), (len(surface.nodes), 1, 1)) for surface in surfaces]
    return trace_norm(state, inner_product(state), list(zip(surfaces, wholes, strict=True)))


def _uniqueness(state: SolvedState, numbers: dict[str, Any], is_asked: bool) -> dict[str, Any]:
    """Whether another solution is excluded, by kappa or, for eps > 0, by the condition below.

        mu* |R| c_0 < 2 sqrt(eps (alpha - L_mu |R sigma_nu|_inf c_0^2)),

    the condition of Theorem 4.2 with an explicit constant (docs/notes/bounds.md).  The norms on
    Gamma_C use the nodal weights, c_0 is the constant of the discrete fields, approached from
    below, and mu* and L_mu may be sampled.  The verdict is therefore about the discrete problem,
    and as certain as these numbers, which ``numbers`` has.
    """
    report: dict[str, Any] = {"verdict": UNKNOWN, "kappa": None}
    try:
        require_coulomb(state)
    except NotApplicable as failure:
        return report | {"why": str(failure)}
    is_small = False
    try:
        c, rho = kappa(state, is_asked)
        report |= {"kappa": c * rho, "c": c, "rho": rho}
        is_small = c * rho < 1.0 - _MARGIN
        isnt = "" if is_small else "not "
        why = f"kappa = mu rho c = {c * rho:.3g} is {isnt}below 1 (eigenvalues to 1e-6)"
    except NotApplicable as failure:
        why = f"there is no kappa, as {failure}"
    why = "; ".join([why, *constant_supports(state)])
    if is_small:
        return report | {"verdict": BY_KAPPA, "why": why}
    trace = numbers["c_0"]
    if state.target.penalty.epsilon == 0.0:
        return report | {"why": why}
    if trace is None:
        return report | {"why": f"{why}; c_0 is not known ({numbers['c_0_reason']})"}
    stress = max(maximum(state.comm, np.abs(fields.smoothed_stress)) for fields in state.contacts)
    product = numbers["friction_coefficient"] * numbers["smoothing_norm"] * trace
    slack = numbers["alpha"] - numbers["friction_lipschitz"] * stress * trace**2
    right = 2.0 * float(np.sqrt(state.target.penalty.epsilon * max(slack, 0.0)))
    covered = product < right
    sampled = "" if numbers["friction_constants"] == "exact" else ", mu* and L_mu sampled"
    why += (
        f"; mu* |R| c_0 = {product:.3g} is {'' if covered else 'not '}below "
        f"2 sqrt(eps (alpha - L_mu |R sigma_nu| c_0^2)) = {right:.3g} "
        f"(c_0 of the fields on this mesh, from below{sampled})"
    )
    return report | {"verdict": SAMPLED if covered else UNKNOWN, "why": why}


def is_unique(summary: Mapping[str, Any]) -> bool:
    """Whether kappa proves that there is no other solution on this mesh."""
    certificate = summary.get("certificate") or {}
    verdict: str | None = certificate.get("constants", {}).get("uniqueness", {}).get("verdict")
    return verdict == BY_KAPPA


def constant_supports(state: SolvedState) -> tuple[Finding, ...]:
    """The finding of kernels that keep constants at supports: rho is unbounded; collective."""
    places = [contact.constant_support() for contact in state.problem.contacts]
    place = next((words for words in places if words is not None), None)
    return () if place is None else (Finding("kappa.constants", place=place),)


_PREFIX_OF_EIGENVALUES = "contact_locking_steklov_"
# The relative accuracy of an eigenvalue; a bound needs no more.
_ACCURACY = 1e-6

# Forms of one problem are the same objects in each solve, by which their compiled forms are kept.


def inner_product(state: SolvedState) -> Expr:
    """``(w, v)_V = int eps(w) : eps(v)`` (10)."""
    data, (v, w) = state.problem.data, state.system.bilinear.arguments()

    def make() -> Expr:
        return ufl.inner(data.strain(w), data.strain(v)) * data.element.elastic_dx(data.dx)

    return state.system.kept("inner product", make)


def require_held(state: SolvedState) -> None:
    """Raise NotApplicable unless displacement conditions alone hold the body."""
    if state.problem.free or state.problem.sprung:
        raise NotApplicable("displacement conditions alone do not hold the body")


def trace_norm(
    state: SolvedState, product: Expr, traces: Sequence[tuple[ContactSurface, FloatArray]]
) -> float:
    """``max sqrt(t(v, v)/b(v, v))`` over the displacements that are zero on Gamma_D; collective.

    ``product`` is b, a bilinear form, and t is ``int v . D v`` with the D (k, d, d) of ``traces``
    at the points of each surface.  The result comes from below.  Raises NotApplicable if the
    eigenvalue solver fails.
    """
    constraints = state.problem.constraints
    with closing(EllipticProblem(state, product, constraints)) as problem:
        trace = problem.matrix.duplicate()
        # The held part keeps the identity in the product and has no trace.
        for surface, blocks in traces:
            weighted = surface.weights[:, None, None] * blocks
            PointStiffness(surface.operator, weighted).add_to(trace, constraints.free_dofs())
        trace.assemble()
        constraints.directions.eliminate(trace, holds=False)
        try:
            return float(_largest(trace, problem.matrix, problem.ksp) ** 0.5)
        finally:
            trace.destroy()


def largest_eigenvalue(comm: Any, size: int, operator: Callable[[FloatArray], FloatArray]) -> float:
    """The largest eigenvalue of a symmetric operator, from below; collective.

    The operator maps the ``size`` values of each rank to as many.  Raises NotApplicable if the
    eigenvalue solver fails.
    """

    def mult(matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array_w[:] = operator(x.array_r)

    sizes = ((size, None), (size, None))
    matrix = PETSc.Mat().createPython(sizes, SimpleNamespace(mult=mult), comm)
    matrix.setUp()
    try:
        return _largest(matrix)
    finally:
        matrix.destroy()


def _largest(
    matrix: PETSc.Mat, product: PETSc.Mat | None = None, inverse: PETSc.KSP | None = None
) -> float:
    from slepc4py import SLEPc

    solver = SLEPc.EPS().create(matrix.getComm())
    solver.setOptionsPrefix(_PREFIX_OF_EIGENVALUES)
    kinds = SLEPc.EPS.ProblemType
    solver.setOperators(matrix, product)
    solver.setProblemType(kinds.HEP if product is None else kinds.GHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
    solver.setTolerances(tol=_ACCURACY)
    if inverse is not None:
        solver.getST().setKSP(inverse)
    try:
        solver.solve()
        if not solver.getConverged():
            raise NotApplicable("the eigenvalue solver did not converge")
        return float(solver.getEigenvalue(0).real)
    except PETSc.Error as error:
        raise_callback_error(error)
        raise NotApplicable("the eigenvalue solver failed") from error
    finally:
        solver.destroy()
