"""V11 and V12: manufactured solutions: rates of elements, and the penalty of contact."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import pytest
import sympy as sp
from manufactured import Errors, Manufactured, X, Y, Z, rate, sampled
from slow import slow
from verification_table import Rows

from contact_locking.fem.spaces import Q1
from contact_locking.results.solution import StudySolution

# A shear, so that the strain is nowhere small, with waves.
PLANE = (sp.sin(X + 2 * Y + 0.3) / 20 + 0.3 * Y, -sp.cos(2 * X - Y) / 20)
SPACE = (
    sp.sin(X + 2 * Z + Y / 2) / 20 + 0.3 * Z,
    sp.sin(Y - Z) * sp.cos(X) / 20 + 0.1,
    -sp.cos(2 * X - Z + Y) / 20,
)
RADIUS = 0.2
HELMHOLTZ = {"kernel": "helmholtz", "radius": RADIUS}
WEAKENING = "0.2 + 0.1/(1 + s)"
# All of it on several ranks once is enough.
NAMES = [
    *(slow(name) for name in ("locking", "contact", "friction")),
    "all together",
]


def wave(dim: int) -> tuple[sp.Expr, sp.Expr]:
    """A positive pressure and R of it: a cosine with the slope 0 at the ends keeps its shape."""
    cosine = sp.cos(sp.pi * X) * (sp.cos(sp.pi * Y) if dim == 3 else 1)
    damping = 1 + RADIUS**2 * (dim - 1) * sp.pi**2
    return 0.3 + damping * cosine / 10, 0.3 + cosine / 10


def problem_of(name: str, dim: int = 2) -> Manufactured:
    u = PLANE if dim == 2 else SPACE
    pressure, smoothed = wave(dim)
    match name:
        case "locking":
            return Manufactured(u, limit=0.1)
        case "edge of a locked zone":
            return Manufactured(u, limit=0.2)
        case "contact":
            # It touches where x < 2/3.
            return Manufactured(u, sp.cos(sp.pi * X) / 10 + 0.05)
        case "friction":
            return Manufactured(u, pressure, smoothed, HELMHOLTZ, WEAKENING)
    return Manufactured(u, pressure, smoothed, HELMHOLTZ, WEAKENING, limit=0.1)


def solve_all(
    given: Manufactured, sizes: Sequence[float]
) -> tuple[list[StudySolution], list[Errors]]:
    solutions = [given.solved(h) for h in sizes]
    return solutions, [given.errors(solution) for solution in solutions]


def assert_optimal(
    name: str, dim: int, sizes: Sequence[float], errors: Sequence[Errors], found: Rows
) -> None:
    in_v, in_l2 = rate(sizes, [e.v for e in errors]), rate(sizes, [e.l2 for e in errors])
    where = f"manufactured, {dim}D: {name}"
    found.add("V11", where, "rate in V", in_v, 1.0, abs=0.05)
    found.add("V11", where, "rate in L2", in_l2, 2.0, abs=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_v11_rates_are_optimal_with_each_law_and_with_all(name: str, found: Rows) -> None:
    sizes = [1 / 4, 1 / 8, 1 / 16, 1 / 32]
    given = problem_of(name)
    solutions, errors = solve_all(given, sizes)
    summary = solutions[-1].summary
    # Nothing is asserted of a law that is asleep.
    assert summary["locked_fraction"] == (1.0 if given.limit < 1.0 else 0.0)
    assert (summary["contact_area"] > 0.5) == (given.pressure is not None)
    if name == "contact":
        assert summary["contact_area"] == pytest.approx(2 / 3, abs=0.04)
    assert (abs(summary["friction_force"][0]) > 0.01) == (given.friction != 0.0)
    assert_optimal(name, 2, sizes, errors, found)


@pytest.mark.slow
@pytest.mark.serial
def test_v11_an_edge_of_the_locked_zone_costs_no_rate_in_v(found: Rows) -> None:
    sizes = [1 / 4, 1 / 8, 1 / 16, 1 / 32]
    name = "edge of a locked zone"
    given = problem_of(name)
    solutions, errors = solve_all(given, sizes)
    norm = sampled(given.strain_norm, 2)
    assert norm.min() < given.limit < norm.max()
    assert 0.1 < solutions[-1].summary["locked_fraction"] < 0.9
    in_v, in_l2 = rate(sizes, [e.v for e in errors]), rate(sizes, [e.l2 for e in errors])
    found.add("V11", f"manufactured, 2D: {name}", "rate in V", in_v, 1.0, abs=0.05)
    # The sources jump at the edge, in cells that the quadrature does not resolve.
    assert in_l2 > 1.5


@pytest.mark.slow
@pytest.mark.serial
def test_v11_the_error_indicator_is_exact_in_the_limit(found: Rows) -> None:
    for name in ("friction", "edge of a locked zone", "all together"):
        given = problem_of(name)
        for h, tolerance in ((1 / 8, 0.05), (1 / 32, 0.015)):
            solution = given.solved(h)
            errors, estimate = given.errors(solution), solution.summary["certificate"]["errors"]
            energy = estimate["mesh"]["energy_norm"] / errors.energy
            locking = estimate["mesh"]["with_locking"] / errors.with_locking
            assert energy == pytest.approx(1.0, abs=tolerance)
            assert locking == pytest.approx(1.0, abs=tolerance)
        where = f"manufactured, 2D: {name}, h = 1/32"
        found.add("V11", where, "estimated over true energy error", energy, 1.0)
        found.add("V11", where, "the same with locking", locking, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_v11_rates_are_optimal_in_space(name: str, found: Rows) -> None:
    sizes = [1 / 4, 1 / 6, 1 / 9, 1 / 13]
    _, errors = solve_all(problem_of(name, 3), sizes)
    assert_optimal(name, 3, sizes, errors, found)


@pytest.mark.serial
@pytest.mark.parametrize("name", ["locking", "contact", "friction", "all together"])
def test_v11_quadrilaterals_converge_at_the_optimal_rate(name: str, found: Rows) -> None:
    given, sizes = dataclasses.replace(problem_of(name), element=Q1), [1 / 8, 1 / 16, 1 / 32]
    norms = [given.errors(given.solved(h)) for h in sizes]
    where = f"manufactured, 2D, Q1: {name}"
    for norm, wanted in (("V", 1.0), ("L2", 2.0)):
        measured = rate(sizes, [getattr(e, norm.lower()) for e in norms])
        found.add("V11", where, f"rate in {norm}, optimal", measured, wanted)
        assert measured > wanted - 0.15


@pytest.mark.serial
def test_v11_hexahedra_converge_at_the_optimal_rate(found: Rows) -> None:
    given, sizes = dataclasses.replace(problem_of("all together", 3), element=Q1), [1 / 4, 1 / 8]
    norms = [given.errors(given.solved(h)) for h in sizes]
    where = "manufactured, 3D, Q1: all together"
    for norm, wanted in (("V", 1.0), ("L2", 2.0)):
        measured = rate(sizes, [getattr(e, norm.lower()) for e in norms])
        found.add("V11", where, f"rate in {norm}, optimal", measured, wanted)
        assert measured > wanted - 0.15


SIZES = [1 / 8, 1 / 16, 1 / 32, 1 / 64]
# With eps = h the foundation would be as soft as the body; it is this much stiffer.
STIFF = 64.0
# The body touches where x < 2/3.
SIGNORINI = Manufactured(
    (sp.sin(X + 2 * Y + 0.3) / 20 + 0.3 * Y, -sp.cos(2 * X - Y) / 20),
    sp.cos(sp.pi * X) + 0.5,
    epsilon=0.0,
)


def error(h: float, epsilon: float) -> Errors:
    """The errors of a penalised solution of Signorini's problem (Chouly and Hild, 2013)."""
    penalty = {"n": 1e4, "epsilon": epsilon} if epsilon > 0.0 else {"n": math.inf}
    return SIGNORINI.errors(SIGNORINI.solved(h, penalty=penalty))


@pytest.mark.parametrize(
    ("text", "epsilon", "expected"),
    [
        slow("0", lambda h: 0.0, 1.0),
        ("h/64", lambda h: h / STIFF, 1.0),
        slow("h^2/64", lambda h: h**2 / STIFF, 1.0),
        slow("sqrt(h)/64", lambda h: math.sqrt(h) / STIFF, 0.5),
    ],
)
def test_v12_error_in_v_is_of_the_order_of_epsilon_plus_h(
    text: str, epsilon: Callable[[float], float], expected: float, found: Rows
) -> None:
    errors = [error(h, epsilon(h)) for h in SIZES]
    in_v = rate(SIZES, [e.v for e in errors])
    found.add("V12", f"Signorini, eps = {text}", "rate in V", in_v, expected, abs=0.15)


@pytest.mark.slow
@pytest.mark.serial
def test_v12_a_mesh_of_epsilon_squared_is_far_finer_than_needed(found: Rows) -> None:
    # The paper takes h = 1/n^2 = eps^2.  For eps = 1/16 that is 1/256, but already from h = 2 eps
    # to h = eps/4 nothing is gained: what is left is the penalty's.
    epsilon = 1 / 16
    coarse, fine = error(2.0 * epsilon, epsilon).v, error(epsilon / 4.0, epsilon).v
    quantity = "V error at h = 1/8 over h = 1/64"
    found.add("V12", "eps = 1/16", quantity, coarse / fine, 1.0, rel=0.2)
