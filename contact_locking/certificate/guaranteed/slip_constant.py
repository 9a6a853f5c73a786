"""An upper bound of the constant c in ``|v_tau| <= c |v|_a`` on Gamma_C, by stresses in balance.

    c^2 <= c_0^2 + max_K sum_F C_F^2/alpha_K,   c_0 = max |s_g|/|g| with |s_g| in the norm of A^-1,

for stresses s_g with ``div s_g = 0`` and the traction ``g t`` along the tangent t of Gamma_C that
is affine on each facet, and the constants C_F of the trace.  The proof is in docs/certificate.md.
"""

from __future__ import annotations

import math

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import largest_eigenvalue
from contact_locking.certificate.guaranteed.bars import Bars
from contact_locking.certificate.guaranteed.body import Elasticity
from contact_locking.certificate.guaranteed.boundary_conditions import held_components
from contact_locking.certificate.guaranteed.contact_tractions import ContactTractions
from contact_locking.certificate.guaranteed.data_oscillation import trace_constants
from contact_locking.certificate.guaranteed.hybrid_system import Boundary, HybridSystem
from contact_locking.certificate.guaranteed.macro_element import macro_element
from contact_locking.certificate.guaranteed.triangles import Triangles
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.parallel import maximum

# Tractions are affine on each facet.
_DEGREE = 1


def slip_constant(
    state: SolvedState, elasticity: Elasticity, contacts: list[ContactTractions]
) -> float:
    """The c of the contacts together, up to the accuracy of one eigenvalue; collective.

    Raises NotApplicable if a linear solve or the eigenvalue solver fails.
    """
    triangles, element = Triangles(state.problem.domain), macro_element(_DEGREE)
    held, size = held_components(state, triangles), len(triangles.areas)
    cells = np.concatenate([item.cells for item in contacts])
    sides = np.concatenate([item.sides for item in contacts])
    tangents = np.concatenate([item.tangent for item in contacts])
    # Of orthonormal polynomials on each facet, in the direction that all ranks share.
    scale = np.sqrt(triangles.lengths[cells, sides])
    signs = triangles.signs[cells, sides, None] ** np.arange(_DEGREE + 1)
    shapes = (scale[:, None] * signs)[:, :, None] * tangents[:, None]
    boundary = Boundary(held, np.zeros((size, 3, _DEGREE + 1, 2)))
    bars = Bars(triangles, _DEGREE, held)
    system = HybridSystem(triangles, element, boundary, bars, state.settings.linear)
    quarters = len(element.quarters)
    with system.traces(elasticity.compliance(np.zeros((size, 3, quarters)))) as traces:

        def apply(values: FloatArray) -> FloatArray:
            moments = np.zeros((size, 3, _DEGREE + 1, 2))
            moments[cells, sides] = values.reshape(-1, _DEGREE + 1, 1) * shapes
            return np.sum(traces(moments)[cells, sides] * shapes, axis=2).reshape(-1)

        resolved = largest_eigenvalue(state.comm, len(cells) * (_DEGREE + 1), apply)
    rest = np.zeros(size)
    np.add.at(rest, cells, trace_constants(triangles)[cells, sides] ** 2)
    return math.sqrt(resolved + maximum(state.comm, rest / elasticity.eigenvalues[:, 0]))
