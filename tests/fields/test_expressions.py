"""Expressions: the values of both backends, and what is refused."""

from __future__ import annotations

import contextlib
import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_locking.errors import InputError
from contact_locking.expressions import MAX_DEPTH, MAX_LENGTH, parse

pytestmark = pytest.mark.serial

Value = Callable[[float, float], float]
Formula = tuple[str, Value]


def _sign(a: float) -> float:
    return float((a > 0) - (a < 0))


UNARY: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "atan": math.atan,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": _sign,
    "-": operator.neg,
}
BINARY: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def _unary(name: str, a: Formula) -> Formula:
    return f"{name}({a[0]})", lambda x, y: UNARY[name](a[1](x, y))


def _binary(sign: str, a: Formula, b: Formula) -> Formula:
    return f"({a[0]} {sign} {b[0]})", lambda x, y: BINARY[sign](a[1](x, y), b[1](x, y))


def _power(a: Formula, exponent: int) -> Formula:
    return f"({a[0]})**{exponent}", lambda x, y: a[1](x, y) ** exponent


def _extreme(name: str, a: Formula, b: Formula, c: Formula) -> Formula:
    pick = {"min": min, "max": max}[name]
    text = f"{name}({a[0]}, {b[0]}, {c[0]})"
    return text, lambda x, y: pick(a[1](x, y), b[1](x, y), c[1](x, y))


def _choice(sign: str, a: Formula, b: Formula, c: Formula, d: Formula) -> Formula:
    compare = COMPARISONS[sign]
    text = f"({c[0]} if {a[0]} {sign} {b[0]} and not x > 0.7 or y == 2 else {d[0]})"

    def value(x: float, y: float) -> float:
        # Both branches, as arrays have to: what is undefined in one is undefined here.
        yes, no = c[1](x, y), d[1](x, y)
        return yes if (compare(a[1](x, y), b[1](x, y)) and not x > 0.7) or y == 2 else no

    return text, value


LEAVES: st.SearchStrategy[Formula] = st.one_of(
    st.just(("x", lambda x, y: x)),
    st.just(("y", lambda x, y: y)),
    st.just(("pi", lambda x, y: math.pi)),
    st.integers(0, 9).map(lambda k: (f"{k}", lambda x, y: float(k))),
    st.floats(0.001, 100).map(lambda v: (f"{v!r}", lambda x, y: v)),
)
FORMULAS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(_unary, st.sampled_from(sorted(UNARY)), inner),
        st.builds(_binary, st.sampled_from(sorted(BINARY)), inner, inner),
        st.builds(_power, inner, st.integers(-3, 3)),
        st.builds(_extreme, st.sampled_from(["min", "max"]), inner, inner, inner),
        st.builds(_choice, st.sampled_from(sorted(COMPARISONS)), inner, inner, inner, inner),
    ),
    max_leaves=8,
)
COORDINATES = st.floats(-2, 2).map(lambda v: round(v, 3))


def _in_python(value: Value, x: float, y: float) -> float | None:
    """The value, or None where Python finds none."""
    try:
        result = value(x, y)
    except (ArithmeticError, ValueError):
        return None
    return result if isinstance(result, float) and math.isfinite(result) else None


@settings(deadline=None)
@given(FORMULAS, COORDINATES, COORDINATES)
def test_numpy_gives_the_value_that_python_gives(formula: Formula, x: float, y: float) -> None:
    text, value = formula
    expected = _in_python(value, x, y)
    if expected is None:
        # Where an intermediate value is infinite, NumPy may still end at a finite one.
        with contextlib.suppress(InputError):
            assert math.isfinite(parse(text).numpy(x=x, y=y))
        return
    expression = parse(text)
    assert expression.numpy(x=x, y=y) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    # An array holds the same values.
    values = expression.numpy(x=np.array([[x], [x]]), y=y)
    assert values.shape == (2, 1)
    assert values == pytest.approx(np.full((2, 1), expected), rel=1e-9, abs=1e-9)


@pytest.fixture(scope="module")
def plane() -> Any:
    """Spatial coordinates whose UFL expressions can be evaluated without a form."""
    ufl = pytest.importorskip("ufl")
    element = pytest.importorskip("basix.ufl").element
    return ufl.SpatialCoordinate(ufl.Mesh(element("P", "triangle", 1, shape=(2,))))


@settings(deadline=None)
@given(FORMULAS, COORDINATES, COORDINATES)
def test_ufl_gives_the_value_that_python_gives(
    plane: Any, formula: Formula, x: float, y: float
) -> None:
    text, value = formula
    expected = _in_python(value, x, y)
    if expected is None:
        return
    try:
        built = parse(text).ufl(x=plane[0], y=plane[1])
    except InputError as error:
        # UFL sees that 0*x is zero and refuses to divide by it, also in a branch not taken.
        assert "not defined" in str(error)
        return
    evaluated = built if isinstance(built, float) else built((x, y))
    assert evaluated == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2", 2.0),
        ("-2**2", -4.0),
        ("1/3", 1 / 3),
        ("x - y - 1", -2.0),
        ("1 if x < 0 or not (x == 1 and y != 3) else 7", 7.0),
        ("atan2(x, -y)", math.atan2(1, -2)),
        ("asin(x/2) + acos(x/2) + e", math.pi / 2 + math.e),
        ("sinh(x) + cosh(x) - exp(x) + tan(0)", 0.0),
        ("sign(-x) + sign(0)", -1.0),
    ],
)
def test_hand_values(text: str, expected: float) -> None:
    assert parse(text).numpy(x=1.0, y=2.0) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("text", ["__import__('os').system('true')", "x.real", "x[0]", "(x, y)"])
def test_only_formulas_are_taken(text: str) -> None:
    with pytest.raises(InputError, match="in the expression"):
        parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sinn(x)", r"unknown function 'sinn' \(did you mean 'sin'\?\)"),
        ("1 + 2*temperature", r"at character 7 \('temperature'\): unknown name"),
        ("é + q", r"unknown name 'é'"),
        ("cos", "needs arguments"),
        ("min(x)", "two or more arguments, not 1"),
        ("x < 1", "a condition is not a number"),
        ("1 if x in y else 0", "expected a condition"),
        ("x # comment", "is not an expression"),
        ("True", "only numbers"),
        ("cos(x, y)", r"takes 1 argument, not 2"),
        ("cos(x=1)", "only numbers"),
        ("x^2", r"written \*\*"),
        ("1 if x else 0", "expected a condition"),
        ("x +", "invalid syntax"),
        ("1/0", "the value is inf"),
        ("sqrt(-1)", "the value is nan"),
        ("x**1000", "exponents are limited"),
        ("1e999", "too large"),
        ("1j", "only numbers"),
        ("x\0", "is not an expression"),
        ("inf", "unknown name 'inf'"),
        ("-" * (MAX_DEPTH + 1) + "x", "nested"),
        ("x" + "+x" * MAX_LENGTH, f"at most {MAX_LENGTH}"),
    ],
)
def test_refused_with_the_reason(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        parse(text)
    assert len(str(caught.value)) < 400
    assert "\n" not in str(caught.value)


@settings(deadline=None)
@given(st.text(max_size=30) | st.text("xyz0189.+-*/()<>=,e if else and not sinmax", max_size=40))
def test_any_text_is_an_expression_or_an_input_error(text: str) -> None:
    with contextlib.suppress(InputError):
        parse(text)


@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400])
def test_only_finite_numbers_are_values(value: float) -> None:
    with pytest.raises(InputError):
        parse(value)


def test_infinite_values_where_they_make_sense() -> None:
    assert parse(math.inf, allow_infinite=True).numpy() == math.inf
    limit = parse("inf if x < 0.5 else 0.02", allow_infinite=True)
    assert limit.numpy(x=np.array([0.0, 1.0])).tolist() == [math.inf, 0.02]
    with pytest.raises(InputError):
        parse(-math.inf, allow_infinite=True)
    with pytest.raises(InputError):
        parse("-inf*x", allow_infinite=True).numpy(x=1.0)


def test_a_value_that_is_not_finite_is_reported_with_its_point() -> None:
    with pytest.raises(InputError, match=r"'log\(x\) \+ y' is -inf at x = 0, y = 2"):
        parse("log(x) + y").numpy(x=np.array([1.0, 0.0]), y=2.0, z=7.0)


def test_constants_are_known_as_such() -> None:
    constant = parse("2*pi")
    assert constant.is_constant
    assert not constant.names
    assert constant.ufl() == constant.numpy() == pytest.approx(2 * math.pi)
    assert constant.numpy(x=np.zeros(3)).tolist() == [constant.numpy()] * 3
    assert not parse("0*x").is_constant
    assert parse("0.3*s + x", ("x", "s")).names == {"x", "s"}


def test_only_the_given_variables_are_known() -> None:
    with pytest.raises(InputError, match="unknown name 'z'; known: x, y, pi, e"):
        parse("z", ("x", "y"))


def test_ufl_that_is_not_defined_is_an_input_error(plane: Any) -> None:
    with pytest.raises(InputError, match="not defined"):
        parse("1/(0*x)").ufl(x=plane[0])


def test_abs_of_abs_in_ufl_ends(plane: Any) -> None:
    # Built-in abs() makes UFL's Abs an operand of itself here.
    once = parse("abs(abs(x)**1)").ufl(x=plane[0])
    assert once.ufl_operands[0] == plane[0]
    assert once((-2.0, 0.0)) == 2.0
