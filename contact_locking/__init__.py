"""Frictional contact of locking materials on DOLFINx.

With your own mesh and forms:

    import contact_locking as cl
    problem = cl.ContactProblem(a, L, bcs, [cl.StrainBall(0.02)], [cl.Contact(facets, plane)])
    solution = problem.solve()

From a study file:

    solution = cl.solve(cl.load("demos/block.yml").parameters)

Names are imported on first use, so that reading study files does not need DOLFINx.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from contact_locking._version import __version__ as __version__

if TYPE_CHECKING:
    from contact_locking.contact.contact import Contact as Contact
    from contact_locking.contact.contact import Convolution as Convolution
    from contact_locking.contact.contact import Coulomb as Coulomb
    from contact_locking.contact.contact import Foundation as Foundation
    from contact_locking.contact.contact import FoundationSpring as FoundationSpring
    from contact_locking.contact.contact import Helmholtz as Helmholtz
    from contact_locking.contact.contact import Kernel as Kernel
    from contact_locking.contact.contact import Local as Local
    from contact_locking.contact.contact import Motion as Motion
    from contact_locking.contact.coulomb import FrictionBound as FrictionBound
    from contact_locking.contact.coulomb import FrictionLaw as FrictionLaw
    from contact_locking.contact.coulomb import Smoothing as Smoothing
    from contact_locking.contact_problem import ContactProblem as ContactProblem
    from contact_locking.errors import ContactLockingError as ContactLockingError
    from contact_locking.errors import InputError as InputError
    from contact_locking.errors import NotConverged as NotConverged
    from contact_locking.inverse.derivatives import Number as Number
    from contact_locking.laws.limits import Deviator as Deviator
    from contact_locking.laws.limits import Direction as Direction
    from contact_locking.laws.limits import StrainBall as StrainBall
    from contact_locking.laws.limits import Volume as Volume
    from contact_locking.laws.limits import Weighted as Weighted
    from contact_locking.laws.material import Eigenstrain as Eigenstrain
    from contact_locking.laws.material import Elasticity as Elasticity
    from contact_locking.process.adaptive_meshes import adapt as adapt
    from contact_locking.process.loop import Process as Process
    from contact_locking.results.output import Extras as Extras
    from contact_locking.results.output import Output as Output
    from contact_locking.results.output import Probe as Probe
    from contact_locking.results.solution import Solution as Solution
    from contact_locking.results.solution import State as State
    from contact_locking.results.solution import StudySolution as StudySolution
    from contact_locking.running.assembly import assemble as assemble
    from contact_locking.running.assembly import check as check
    from contact_locking.running.run import save as save
    from contact_locking.running.run import solve_cases as solve_cases
    from contact_locking.running.run import write as write
    from contact_locking.running.run import write_steps as write_steps
    from contact_locking.running.solving import solve as solve
    from contact_locking.running.solving import solve_adaptively as solve_adaptively
    from contact_locking.running.solving import solve_assembled as solve_assembled
    from contact_locking.running.solving import solve_steps as solve_steps
    from contact_locking.shapes.analytic import Cylinder as Cylinder
    from contact_locking.shapes.analytic import HalfSpace as HalfSpace
    from contact_locking.shapes.analytic import LevelSet as LevelSet
    from contact_locking.shapes.analytic import Sphere as Sphere
    from contact_locking.shapes.faceted import Polyline as Polyline
    from contact_locking.shapes.faceted import TriangulatedSurface as TriangulatedSurface
    from contact_locking.solver.settings import Adaptation as Adaptation
    from contact_locking.solver.settings import Settings as Settings
    from contact_locking.solver.settings import Steps as Steps
    from contact_locking.study_file import from_mapping as from_mapping
    from contact_locking.study_file import load as load
    from contact_locking.study_file.parameters import Parameters as Parameters
    from contact_locking.supports.support import BodyForce as BodyForce
    from contact_locking.supports.support import Displacement as Displacement
    from contact_locking.supports.support import Pressure as Pressure
    from contact_locking.supports.support import Spring as Spring
    from contact_locking.supports.support import Support as Support
    from contact_locking.supports.support import TotalForce as TotalForce
    from contact_locking.supports.support import Traction as Traction
    from contact_locking.theory.solutions import branch as branch
    from contact_locking.theory.solutions import equilibria as equilibria
    from contact_locking.values.value import Tabulated as Tabulated

# The public names of each module.
_NAMES = {
    "contact.contact": "Contact Convolution Coulomb Foundation FoundationSpring Helmholtz "
    "Kernel Local Motion",
    "contact.coulomb": "FrictionBound FrictionLaw Smoothing",
    "contact_problem": "ContactProblem",
    "errors": "ContactLockingError InputError NotConverged",
    "laws.limits": "Deviator Direction StrainBall Volume Weighted",
    "laws.material": "Eigenstrain Elasticity",
    "process.adaptive_meshes": "adapt",
    "process.loop": "Process",
    "results.output": "Extras Output Probe",
    "running.solving": "solve solve_adaptively solve_assembled solve_steps",
    "results.solution": "Solution State",
    "running.run": "save solve_cases write write_steps",
    "inverse.derivatives": "Number",
    "shapes.analytic": "Cylinder HalfSpace LevelSet Sphere",
    "shapes.faceted": "Polyline TriangulatedSurface",
    "solver.settings": "Adaptation Settings Steps",
    "running.assembly": "assemble check",
    "study_file": "from_mapping load",
    "study_file.parameters": "Parameters",
    "supports.support": "BodyForce Displacement Pressure Spring Support TotalForce Traction",
    "theory.solutions": "branch equilibria",
    "values.value": "Tabulated",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    # New shapes and strain limits, and second names such as StudySolution, need no row above.
    further = ("shapes.analytic", "laws.limits", "results.solution") if name[:1].isupper() else ()
    for home in [_HOME[name]] if name in _HOME else further:
        module = importlib.import_module(f"{__name__}.{home}")
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
