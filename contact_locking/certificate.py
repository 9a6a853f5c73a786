"""Bounds that the theory proves, each beside its measured value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking import forms
from contact_locking.coefficients import Material
from contact_locking.conditions import Constraints
from contact_locking.convex import positive_part, squared_norm, unit_ball_excess
from contact_locking.domain import Domain
from contact_locking.material import strain
from contact_locking.results import integral
from contact_locking.solver.linear import create_ksp, default_options

# Rounding and the solver's tolerance may put a measured value this share above its bound.
_SLACK = 1e-6
# Options for the nonlinear solve do not reach the solve for the dual norm.
_PREFIX = "contact_locking_norm_"


def proved_bounds(
    domain: Domain,
    u: fem.Function,
    data: forms.ProblemData,
    material: Material,
    constraints: Constraints,
    free_motions: int,
) -> dict[str, dict[str, Any]]:
    """The a priori bounds of Lemma 4.5 iii and Theorem 4.9 a)-c) for the penalised solution.

    With ``v = u`` in (25), a gap >= 0 and homogeneous displacement conditions every term on the
    left is non-negative, ``a(u,u) >= alpha |u|_V^2``, and so

        |u|_V <= |f|_V/alpha,
        (1/eps) |[u_nu - gap]^+|^2 <= |f|_V^2/alpha,   2n |[|eps| - M]^+|^2 <= |f|_V^2/alpha.

    Each entry holds ``value``, ``bound`` and ``holds``; where the assumptions fail, ``bound`` and
    ``holds`` are None and ``reason`` says why.  Collective; one linear solve.
    """
    eps = strain(u)
    values = {"displacement_norm": float(np.sqrt(integral(domain, squared_norm(eps) * data.dx)))}
    if np.isfinite(data.n.value):
        values |= _penalties(domain, u, data)
    reason = _not_covered(domain, data, constraints, free_motions)
    if reason:
        return {
            name: {"value": value, "bound": None, "holds": None, "reason": reason}
            for name, value in values.items()
        }
    load = dual_norm(domain, u.function_space, data, constraints)
    bounds = dict.fromkeys(values, load**2 / material.ellipticity)
    bounds["displacement_norm"] = load / material.ellipticity
    return {
        name: {
            "value": value,
            "bound": bounds[name],
            "holds": bool(value <= bounds[name] * (1.0 + _SLACK)),
        }
        for name, value in values.items()
    }


def _penalties(domain: Domain, u: fem.Function, data: forms.ProblemData) -> dict[str, float]:
    """The penalised violations of both constraints; they are no more for n = inf."""
    eps = strain(u)
    excess = unit_ball_excess(eps, data.inverse_limit) ** 2 * squared_norm(eps)
    values = {
        "locking_penalty": 2.0 * float(data.n.value) * integral(domain, excess * data.dx),
    }
    if data.contact is not None:
        opening = ufl.inner(u, data.contact.normal) - data.contact.gap
        values["contact_penalty"] = integral(
            domain, positive_part(opening) ** 2 / data.epsilon * data.contact.ds
        )
    return values


def dual_norm(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
) -> float:
    """``|f|_V = |z|_V`` with ``(z, v)_V = int eps(z) : eps(v) = (f, v)`` (10), (13); collective.

    Displacement conditions must be homogeneous.
    """
    v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
    matrix = petsc.assemble_matrix(
        fem.form(ufl.inner(strain(w), strain(v)) * data.dx), bcs=constraints.conditions
    )
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    right = petsc.assemble_vector(fem.form(forms.external_work(v, data)))
    right.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    owned = right.getLocalSize()
    right.array_w[constraints.dofs[constraints.dofs < owned]] = 0.0
    solution = right.duplicate()
    size = space.dofmap.index_map.size_global * space.dofmap.index_map_bs
    options = default_options("auto", domain.dim, size, domain.comm) | {"ksp_rtol": 1e-8}
    solver = create_ksp(matrix, options, prefix=_PREFIX)
    solver.solve(right, solution)
    square = right.dot(solution)
    for item in (solver, matrix, right, solution):
        item.destroy()
    return float(np.sqrt(max(square, 0.0)))


def _not_covered(
    domain: Domain, data: forms.ProblemData, constraints: Constraints, free_motions: int
) -> str:
    """Why the bounds do not apply, or nothing."""
    if free_motions:
        return "contact alone holds a rigid motion, so |.|_V is not a norm"
    if _anywhere(domain, [c.g.x.array for c in constraints.conditions], lambda a: a != 0.0):
        return "a displacement other than zero is prescribed"
    if data.contact is not None and _anywhere(
        domain, [data.contact.gap.x.array], lambda a: a < 0.0
    ):
        return "the gap is negative somewhere"
    return ""


def _anywhere(domain: Domain, arrays: Sequence[Any], test: Any) -> bool:
    local = any(bool(np.any(test(array))) for array in arrays)
    return bool(domain.comm.allreduce(local))
