"""The numbers of a summary: what each means and in which unit."""

from __future__ import annotations

from dataclasses import dataclass

LOAD_UNIT_NOTE = (
    "Units follow from those of the study file: with metres and pascals, forces are in newtons and "
    "energies in joules. In two dimensions forces and energies are per unit of thickness, and the "
    "measure of a part of the boundary is a length."
)


@dataclass(frozen=True)
class Quantity:
    """A number or vector of summary.json by its dotted key.

    A study plots it over what varies if it is ``plotted``; its differences have a rate if it
    ``settles``, which counts of cells, points and iterations do in jumps.
    """

    key: str
    meaning: str
    unit: str
    plotted: bool = True
    settles: bool = True


QUANTITIES = (
    Quantity("compliance", "work of the loads, (f, u)", "energy"),
    Quantity("elastic_energy", "elastic energy, ½ a(u, u)", "energy"),
    Quantity("strain_norm_max", "largest strain |ε(u)|", "1"),
    Quantity("locked_fraction", "share of the body that is locked, |ε| ≥ M", "1", settles=False),
    Quantity("contact_force", "resultant of the contact pressure on the body", "force"),
    Quantity("friction_force", "resultant of the friction on the body", "force"),
    Quantity("contact_area", "part of Γ_C under pressure", "area", settles=False),
    Quantity("slip_area", "part of Γ_C that slips", "area", settles=False),
    Quantity("penetration_max", "largest penetration [u_ν − g]⁺", "length"),
    Quantity("iterations.tangents", "tangents factorised or preconditioned", "1", settles=False),
    Quantity("wall_seconds", "time of the whole solve", "s", settles=False),
    Quantity("residual", "equilibrium residual relative to the forces", "1", plotted=False),
    Quantity("duality_gap", "duality gap of the last solve", "energy", plotted=False),
    Quantity(
        "friction_fixed_point.contraction",
        "factor by which the friction fixed point contracts",
        "1",
        plotted=False,
    ),
    Quantity("dofs", "degrees of freedom", "1", plotted=False),
    Quantity("cells", "cells of the mesh", "1", plotted=False),
)

#: What the proved bounds and the criteria of the certificate measure, where the name is too short.
MEANINGS = {
    "displacement_norm": "‖u‖_V ≤ ‖f‖_V / α",
    "locking_penalty": "2n ∫ ([|ε| − M]⁺)² ≤ ‖f‖_V² / α",
    "contact_penalty": "(1/ε) ∫ ([u_ν − g]⁺)² ≤ ‖f‖_V² / α",
}
