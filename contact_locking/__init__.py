"""Frictional contact of locking materials on DOLFINx.

On a mesh, a space and forms of your own:

    import contact_locking as cl
    problem = cl.ContactProblem(a, L, bcs, [cl.StrainBall(0.02)], [cl.Contact(facets, plane)])
    solution = problem.solve()

From a study file:

    solution = cl.solve(cl.load("demos/block.yml").parameters)

Names are imported when they are first used: what needs no DOLFINx works without it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from contact_locking._version import __version__ as __version__

if TYPE_CHECKING:
    from contact_locking.certificate.verdict import Extras
    from contact_locking.contact.contact import (
        Contact,
        Force,
        FoundationSpring,
        Gap,
        Motion,
        Tilt,
    )
    from contact_locking.contact.coulomb import Convolution, Coulomb, Helmholtz, Local
    from contact_locking.contact.friction_bound import FrictionBound
    from contact_locking.contact_problem import ContactProblem
    from contact_locking.errors import ContactLockingError, InputError, NotConverged
    from contact_locking.laws.foundation import Cylinder, HalfSpace, LevelSet, Sphere
    from contact_locking.laws.friction import FrictionLaw
    from contact_locking.laws.polyline import Polyline
    from contact_locking.laws.triangulated import TriangulatedSurface
    from contact_locking.problem.elasticity import Elasticity
    from contact_locking.problem.limits import (
        Deviator,
        Direction,
        LargestPrincipal,
        StrainBall,
        Volume,
        Weighted,
    )
    from contact_locking.process.adaptivity import solve, solve_adaptively
    from contact_locking.process.solving import check, solve_assembled, solve_steps
    from contact_locking.results.solution import Solution, State, StudySolution
    from contact_locking.running.writing import save, write
    from contact_locking.sensitivity.parameters import Number
    from contact_locking.solver.task import Settings
    from contact_locking.study.assembly import assemble
    from contact_locking.study_file import from_mapping, load
    from contact_locking.study_file.parameters import Parameters
    from contact_locking.supports.supports import Support

__all__ = [
    "Contact",
    "ContactLockingError",
    "ContactProblem",
    "Convolution",
    "Coulomb",
    "Cylinder",
    "Deviator",
    "Direction",
    "Elasticity",
    "Extras",
    "Force",
    "FoundationSpring",
    "FrictionBound",
    "FrictionLaw",
    "Gap",
    "HalfSpace",
    "Helmholtz",
    "InputError",
    "LargestPrincipal",
    "LevelSet",
    "Local",
    "Motion",
    "NotConverged",
    "Number",
    "Parameters",
    "Polyline",
    "Settings",
    "Solution",
    "Sphere",
    "State",
    "StrainBall",
    "StudySolution",
    "Support",
    "Tilt",
    "TriangulatedSurface",
    "Volume",
    "Weighted",
    "assemble",
    "check",
    "find_equilibria",
    "from_mapping",
    "load",
    "save",
    "solve",
    "solve_adaptively",
    "solve_assembled",
    "solve_steps",
    "write",
]

_HOME = {
    "Contact": "contact.contact",
    "ContactLockingError": "errors",
    "ContactProblem": "contact_problem",
    "Convolution": "contact.coulomb",
    "Coulomb": "contact.coulomb",
    "Cylinder": "laws.foundation",
    "Deviator": "problem.limits",
    "Direction": "problem.limits",
    "Elasticity": "problem.elasticity",
    "Extras": "certificate.verdict",
    "Force": "contact.contact",
    "FoundationSpring": "contact.contact",
    "FrictionBound": "contact.friction_bound",
    "FrictionLaw": "laws.friction",
    "Gap": "contact.contact",
    "HalfSpace": "laws.foundation",
    "Helmholtz": "contact.coulomb",
    "InputError": "errors",
    "LargestPrincipal": "problem.limits",
    "LevelSet": "laws.foundation",
    "Local": "contact.coulomb",
    "Motion": "contact.contact",
    "NotConverged": "errors",
    "Number": "sensitivity.parameters",
    "Parameters": "study_file.parameters",
    "Polyline": "laws.polyline",
    "Settings": "solver.task",
    "Solution": "results.solution",
    "Sphere": "laws.foundation",
    "State": "results.solution",
    "StrainBall": "problem.limits",
    "StudySolution": "results.solution",
    "Support": "supports.supports",
    "Tilt": "contact.contact",
    "TriangulatedSurface": "laws.triangulated",
    "Volume": "problem.limits",
    "Weighted": "problem.limits",
    "assemble": "study.assembly",
    "check": "process.solving",
    "find_equilibria": "process.solving",
    "from_mapping": "study_file",
    "load": "study_file",
    "save": "running.writing",
    "solve": "process.adaptivity",
    "solve_adaptively": "process.adaptivity",
    "solve_assembled": "process.solving",
    "solve_steps": "process.solving",
    "write": "running.writing",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
