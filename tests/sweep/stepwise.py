"""Whether the solutions of a process are right: forces in balance, laws kept, any units alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution

from . import judge
from .case import Study

# Agreement in other units, relative to the largest energy of the process, and the energies that
# rounding leaves where the modulus is 1 and strains are 1e-5 or more.
_ALIKE, _NOTHING = 1e-5, 1e-20
# Balance of forces, and limits of displacements and tractions, relative to the largest.
_FORCE, _EXCESS = 1e-6, 1e-6
_EPS = float(np.finfo(float).eps)


def complaint(solutions: Sequence[StudySolution]) -> str:
    """What is wrong with the steps of a process; "" if nothing is."""
    found = []
    for solution in solutions:
        at = f"at t = {solution.time:g}"
        criteria = solution.summary["certificate"]["criteria"]
        failed = [name for name, entry in criteria.items() if not entry["holds"]]
        found += [f"{at}: {name} fails" for name in failed]
        found += [f"{at}: {text}" for text in _wrong(solution)]
    return "; ".join(found)


def _wrong(solution: StudySolution) -> list[str]:
    found = []
    u = solution.displacement.x.array.reshape(-1, 2)
    reach = float(np.abs(u).max(initial=0.0))
    if not np.isfinite(solution.displacement.x.array).all():
        return ["the displacement is not finite"]
    # The gap of a tool is as large as the way on which the tool has followed the body.
    gaps = [item.gap for item in solution.contacts if not item.contact.is_free]
    if judge.flight(u, [np.array(solution.parameters.mesh.geometry.size), *gaps]) > 1.0:
        return [f"the body has run away by {reach:.1e}"]
    exact = solution.summary["penalty"]["epsilon"] == 0.0
    for fields in solution.contacts:
        free, peak = fields.free, float(np.abs(fields.pressure).max(initial=0.0))
        opening = (fields.gap - fields.u_normal)[free]
        size = reach + float(np.abs(fields.gap).max(initial=0.0))
        if exact and opening.min(initial=0.0) < -(_EXCESS + 8.0 * _EPS) * size:
            found.append(f"a node enters {fields.contact.key} by {-opening.min():.1e}")
        if fields.pressure.min(initial=0.0) < -_EXCESS * peak:
            found.append(f"{fields.contact.key} pulls")
        over = np.linalg.norm(fields.traction, axis=1) - fields.bound * (1.0 + _EXCESS)
        if over[free].max(initial=0.0) > _EXCESS * peak:
            found.append(f"friction is above its bound on {fields.contact.key}")
    for entry in solution.summary["contacts"]:
        tool = entry.get("tool")
        if tool is not None:
            force = np.add(entry["contact_force"], entry["friction_force"])
            if abs(force @ tool["direction"] - tool["force"]) > _FORCE * tool["force"]:
                found.append("the force of a tool is not balanced")
    return found


def unlike(solutions: Sequence[StudySolution], twins: Sequence[StudySolution], study: Study) -> str:
    """How the energies of a process differ with a modulus of 1 and a length of 1; "" if they agree.

    Displacements of bodies at rest may differ.
    """
    young = study["material"]["elasticity"]["young"]
    widths = (one[0].parameters.mesh.geometry.size[0] for one in (solutions, twins))
    length = next(widths) / next(widths)
    scale = young * length ** (3 if study["mesh"].get("axisymmetric") else 2)
    if [a.time for a in solutions] != [b.time for b in twins]:
        return "the steps in other units end at other times"
    for name in ("elastic_energy", "dissipated"):
        a, b = (_column(items, name) for items in (solutions, twins))
        apart = float(np.abs(a / scale - b).max(initial=0.0))
        largest = float(np.abs(_column(twins, "elastic_energy")).max(initial=0.0))
        if apart > _ALIKE * largest + _NOTHING:
            return f"{name} in other units differs by {apart:.1e}"
    return ""


def _column(solutions: Sequence[StudySolution], name: str) -> FloatArray:
    return np.asarray(solutions[-1].history.column(name))
