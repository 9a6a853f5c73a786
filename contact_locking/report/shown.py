"""Values of a summary or a table as text that one reads."""

from __future__ import annotations

from typing import Any


def shown(value: Any) -> str:
    """The text of a value: four digits, a power of ten as a superscript, infinity as a sign."""
    match value:
        case None:
            return "\N{EN DASH}"
        case bool():
            return "yes" if value else "no"
        case int() if abs(value) < 10**15:
            digits = f"{value:,}".replace(",", "\N{THIN SPACE}")
            return digits.replace("-", "\N{MINUS SIGN}")
        case int() | float() if abs(value) < 1e308:
            return _number(float(value))
        case int() | float():
            return _infinite(value)
        case "inf":
            return "\N{INFINITY}"
        case list():
            return "(" + ", ".join(map(shown, _without_rounding(value))) + ")"
        case dict():
            return ", ".join(f"{key}: {shown(item)}" for key, item in value.items())
    return str(value)


def _without_rounding(vector: list[Any]) -> list[Any]:
    """The vector with zero for components that rounding alone keeps from zero."""
    if not vector or not all(isinstance(item, float) for item in vector):
        return vector
    largest = max(map(abs, vector))
    return [0.0 if abs(item) < 1e-12 * largest else item for item in vector]


def _infinite(value: float) -> str:
    if value != value:
        return "not a number"
    return "\N{INFINITY}" if value > 0 else "\N{MINUS SIGN}\N{INFINITY}"


def _number(value: float) -> str:
    """Four digits, and a power of ten as a superscript: 1.2x10^-5 for 1.2e-05."""
    mantissa, _, exponent = f"{value + 0.0:.4g}".replace("-", "\N{MINUS SIGN}").partition("e")
    if not exponent:
        return mantissa
    power = exponent.lstrip("+").replace("\N{MINUS SIGN}", "-")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if mantissa == "1" else f"{mantissa}\N{MULTIPLICATION SIGN}10{raised}"
