"""The numbers of a problem, by what a user sees of a solution, and how two versions compare.

A problem is a study file as plain data, a file of the repository with values set by their dotted
keys, or a file of verification tests, whose rows of docs/verification.md are the numbers.
"""

from __future__ import annotations

import copy
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import contact_locking as cl

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS, NUMBERS = (Path(__file__).with_name(f"{name}.json") for name in ("problems", "numbers"))

Data = dict[str, Any]

# Forces, displacements and shares agree to this, relative to the scale of the problem.
TOLERANCE = 1e-6
# So much stiffer the material is where it is asked which numbers the problem determines: in states
# at a kink, where rounding decides, numbers then change by far more.
_STIFFER = 1.0 + 1e-9
_MODULI = ("young", "lambda", "mu", "stiffness")
# A problem that takes so many times longer than it did, and a minute of the processor more, has no
# end.
_SLOWER, _SPARE = 20, 60
# Numbers below it that should be zero are rounding.
_ROUNDING = 1e-6
# A force below this share of the scale is none, and so is any number below the other.
_NO_FORCE, _NOTHING = 1e-10, 1e-25
_STATES = 3


def read(path: Path) -> Data:
    data: Data = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return data


def numbers_of(problem: Data, usual_seconds: float = 0.0, stiffer: bool = False) -> Data:
    """What comes out of a problem; no exception leaves.

    With ``stiffer`` the moduli are larger by a billionth.
    """
    if "tests" in problem:
        return _rows(problem["tests"])

    def stop(*_: Any) -> None:
        raise TimeoutError

    began = time.process_time()
    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, _SLOWER * usual_seconds + _SPARE)
    try:
        study = study_of(problem)
        folder = (ROOT / problem["file"]).parent if "file" in problem else ROOT
        if stiffer:
            study["material"] = _stiffer(study.get("material", {}))
        solution = cl.solve(cl.from_mapping(study, folder), MPI.COMM_SELF)
        numbers = _numbers(solution)
    except cl.InputError:
        numbers = {"outcome": "InputError"}
    except Exception as error:
        numbers = {"outcome": type(error).__name__}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return numbers | {"seconds": round(time.process_time() - began, 2)}


def study_of(problem: Data) -> Data:
    """The study file of a problem as plain data."""
    if "file" not in problem:
        return copy.deepcopy(problem)
    from ruamel.yaml import YAML

    study: Data = YAML(typ="safe", pure=True).load(ROOT / problem["file"])
    for key, value in problem.get("set", {}).items():
        *sections, name = key.split(".")
        section = study
        for place in sections:
            section = section.setdefault(place, {})
        section[name] = value
    return study


def _stiffer(material: Any, is_modulus: bool = False) -> Any:
    match material:
        case dict():
            return {k: _stiffer(v, is_modulus or k in _MODULI) for k, v in material.items()}
        case list():
            return [_stiffer(value, is_modulus) for value in material]
        case str() if is_modulus:
            return f"({material})*{_STIFFER!r}"
        case float() | int() if is_modulus:
            return material * _STIFFER
    return material


def _numbers(solution: cl.StudySolution) -> Data:
    summary, history = solution.summary, list(solution.history)
    if not solution.converged:
        infeasible = solution.failure.startswith("solver.infeasible")
        return {"outcome": "infeasible" if infeasible else "not converged"}
    u = solution.displacement
    entries = summary.get("contacts") or ([summary] if "contact_force" in summary else [])
    forces = {f"reactions {name}": force for name, force in summary["reactions"].items()}
    for place, entry in enumerate(entries):
        for name in ("contact_force", "friction_force"):
            forces[f"{name} {place}"] = entry[name]
    for name in ("contact_force", "friction_force"):
        columns = [key for key in (history or [{}])[0] if key.startswith(f"{name}_")]
        for axis, column in enumerate(columns):
            forces[f"{name} over time {axis}"] = [row[column] for row in history]
    largest = float(summary["displacement_max"])
    # Forces that balance each other have no resultant; pressures and the energy tell their size.
    scales = [abs(x) for force in forces.values() for x in force]
    scales += [entry["pressure_max"] * entry["contact_area"] for entry in entries]
    if largest:
        scales.append(2.0 * summary["elastic_energy"] / largest)
    points = solution.contact_points
    assert points is not None
    states = [
        np.bincount(points.state[points.contact == place], minlength=_STATES).tolist()
        for place in range(len(entries))
    ]
    return {
        "outcome": "converged",
        "tangents": [int(row["tangents"]) for row in history]
        or [int(summary["iterations"]["tangents"])],
        "scale": _short(max(scales, default=0.0)),
        "forces": {name: _rounded(force, max(scales)) for name, force in forces.items()},
        "displacements": _short([largest, float(np.sqrt(np.mean(u.x.array**2)))]),
        "energy": _short(float(summary["elastic_energy"])),
        "limit_used": _short(summary.get("limit_used") or 0.0),
        "locked": _short(summary.get("locked_fraction") or 0.0),
        "open, stick, slip": {str(place): counts for place, counts in enumerate(states)},
    }


def _short(value: Any) -> Any:
    """Numbers with some digits more than are compared."""
    if isinstance(value, list):
        return [_short(x) for x in value]
    return float(f"{value:.9g}")


def _rounded(force: Sequence[float], scale: float) -> list[float]:
    """Without the digits that are rounding beside the other forces."""
    return [_short(x) if abs(x) > _NO_FORCE * scale else 0.0 for x in force]


def _rows(tests: str) -> Data:
    """The rows of the verification table that a file of tests has found."""
    command = [sys.executable, "-m", "golden.rows", str(ROOT / tests)]
    began = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    rows = {
        name: _short(computed)
        for name, computed, exact in lines
        # An error that should be zero is rounding.
        if exact or abs(computed) > _ROUNDING
    }
    outcome = "converged" if rows else "no rows"
    return {"outcome": outcome, "rows": rows, "seconds": round(time.perf_counter() - began, 2)}


def determined(numbers: Data, again: Data) -> Data:
    """The ``numbers`` that another solve of nearly the same problem has as well."""
    unsure = {quantity for quantity, *_ in differences(numbers, again, 0.1 * TOLERANCE)}
    if "outcome" in unsure:
        return {}
    kept: Data = {}
    for name, value in numbers.items():
        if isinstance(value, dict):
            kept[name] = {k: v for k, v in value.items() if f"{name}: {k}" not in unsure}
        elif name not in unsure:
            kept[name] = value
    if "scale" in unsure:
        # All forces are rounding.
        del kept["forces"]
    return kept


def differences(
    golden: Data, found: Data, tolerance: float = TOLERANCE
) -> list[tuple[str, Any, Any]]:
    """The quantities that differ, with both values; those that are not golden are not compared."""
    if golden["outcome"] != found["outcome"]:
        return [("outcome", golden["outcome"], found["outcome"])]
    differ = []
    for quantity, value, agrees in _quantities(golden, tolerance):
        section, _, name = quantity.partition(": ")
        other = found.get(section)
        other = other.get(name) if name and isinstance(other, Mapping) else other
        if other is None or np.shape(other) != np.shape(value) or not agrees(other):
            differ.append((quantity, value, other))
    return differ


def _quantities(golden: Data, tolerance: float) -> Iterator[tuple[str, Any, Callable[[Any], bool]]]:
    """Each quantity with its value and whether another value agrees with it."""

    def within(value: Any, allowed: float) -> Callable[[Any], bool]:
        least = max(allowed, _NOTHING)
        return lambda other: bool(np.all(np.abs(np.subtract(other, value)) <= least))

    for name, force in golden.get("forces", {}).items():
        yield f"forces: {name}", force, within(force, tolerance * golden["scale"])
    for name, value in golden.get("rows", {}).items():
        yield f"rows: {name}", value, within(value, tolerance * max(abs(value), _ROUNDING))
    for name, counts in golden.get("open, stick, slip", {}).items():
        yield f"open, stick, slip: {name}", counts, within(counts, 0.0)
    for name in ("scale", "displacements", "energy", "limit_used", "locked"):
        if name in golden:
            value = golden[name]
            # The limit is used by a number of order one.
            scale = 1.0 if name in ("limit_used", "locked") else np.max(value)
            yield name, value, within(value, tolerance * scale)
    if "tangents" in golden:
        yield "tangents", golden["tangents"], within(golden["tangents"], 1.0)
