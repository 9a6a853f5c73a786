"""The discrete system: residual, tangent, friction bound, and what each solver relies on."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from problems import block, column

from contact_locking.monitor import Monitor
from contact_locking.problem.system import PenalisedSystem
from contact_locking.running import solving
from contact_locking.study.assembly import StudyProblem, assemble
from contact_locking.study_file.parameters import Parameters


def _system(parameters: Parameters) -> tuple[StudyProblem, PenalisedSystem]:
    from mpi4py import MPI

    made = assemble(parameters, MPI.COMM_WORLD)
    system = PenalisedSystem(made.data, made.u, made.constraints)
    return made, system


def _rough_state(made: StudyProblem, size: float) -> None:
    """A displacement that locks, touches and slips somewhere, the same on any partition."""
    dim = made.domain.dim
    made.u.interpolate(
        lambda x: size * np.array([np.sin(7.0 * x[0] + 3.0 * i + 5.0 * x[1]) for i in range(dim)])
    )
    made.constraints.apply(made.u)
    for contact in made.contacts:
        made.data.bounds[contact] = 0.5 + contact.surface.points[:, 0]


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [0.0, 0.01, 0.3])
def test_tangent_is_the_derivative_of_the_residual(dim: int, size: float) -> None:
    parameters = block(dim, 0.2 if dim == 2 else 0.5, penalty__n=50.0, penalty__epsilon=0.1)
    made, system = _system(parameters)
    _rough_state(made, size)
    matrix = system.create_matrix()
    x, step, product, plus, minus = (matrix.createVecRight() for _ in range(5))
    system.displacement(x)
    system.tangent(x, matrix)
    np.testing.assert_array_equal(np.isfinite(matrix.getDiagonal().array_r), True)
    direction = fem.Function(made.u.function_space)
    direction.interpolate(lambda y: np.array([np.cos(3.0 * y[0] + 2.0 * i) for i in range(dim)]))
    direction.x.array[made.constraints.dofs] = 0.0
    step.array_w[:] = direction.x.array[: step.getLocalSize()]
    matrix.mult(step, product)
    t = 1e-7
    system.residual(x + t * step, plus)
    system.residual(x - t * step, minus)
    difference = (plus - minus) / (2.0 * t)
    # At zero the positive part has a kink; its one-sided derivatives average to the half.
    tolerance = 1e-6 if size else 0.5 / 0.1
    assert (difference - product).norm() <= tolerance * product.norm()
    matrix.destroy()


@pytest.mark.serial
def test_residual_is_the_derivative_of_the_energy() -> None:
    made, system = _system(block(penalty__n=50.0, penalty__epsilon=0.1, discretisation__degree=2))
    _rough_state(made, 0.1)
    f, x = made.u.x.petsc_vec.copy(), made.u.x.array.copy()
    direction, slope = made.constraints.free_part(np.cos(np.arange(len(x)) ** 2)), 0.0
    for t in (-1e-5, 1e-5):
        made.u.x.array[:] = x + t * direction
        slope += system.potential() / (2.0 * t)
    system.residual(f.copy(), f)
    assert slope == pytest.approx(float(f.array_r @ direction), rel=1e-6)


def test_petsc_options_of_the_caller_win_and_leave_no_trace() -> None:
    from petsc4py import PETSc

    solution = solving.solve(
        block(h=0.25, solver__petsc={"ksp_type": "gmres", "pc_type": "lu"}),
        petsc_options={"ksp_type": "fgmres"},
    )
    assert solution.converged
    assert not [key for key in PETSc.Options().getAll() if key.startswith("contact_locking")]


def test_unknown_petsc_factorisation_is_reported_and_not_a_crash() -> None:
    solution = solving.solve(block(h=0.25), petsc_options={"pc_factor_mat_solver_type": "nonsense"})
    assert not solution.converged
    assert "linear solve" in solution.summary["reason"]


def test_a_body_held_by_contact_alone_finds_its_place() -> None:
    solution = solving.solve(column(contact={"on": "bottom", "gap": 5.0}))
    assert solution.converged
    assert solution.summary["contact_force"][1] == pytest.approx(0.05, rel=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("method", ["penalty", "interior_point"])
def test_too_few_iterations_are_reported_with_what_was_reached(method: str) -> None:
    solution = solving.solve(block(penalty__n=1e6, solver={"method": method, "max_iterations": 2}))
    assert not solution.converged
    assert (
        "Newton steps" in solution.summary["reason"] or "2 interior" in solution.summary["reason"]
    )
    assert solution.summary["suggestion"]
    assert np.isfinite(solution.summary["compliance"])


@pytest.mark.serial
def test_friction_that_may_not_settle_is_reported() -> None:
    solution = solving.solve(block(solver={"method": "penalty", "max_friction_updates": 2}))
    assert not solution.converged
    assert "friction bound" in solution.summary["reason"]


@pytest.mark.serial
def test_an_error_in_a_callback_is_that_error_and_not_a_failed_solve() -> None:
    class Interrupting(Monitor):
        def iteration(self, k: int, residual: float) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solving.solve(block(h=0.25, solver={"method": "penalty"}), monitor=Interrupting())
