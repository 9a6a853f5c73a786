"""The numbers of a summary: their meanings and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from contact_locking.results.contact_points import contact_name


@dataclass(frozen=True)
class Quantity:
    """A number or vector of summary.json by its dotted key.

    A study plots every quantity that is not ``hidden`` over the keys that vary.  The differences of
    one that ``settles`` have a rate, one that ``vanishes`` has a rate itself, and counts of cells,
    points and iterations change in ``jumps``.  One that is ``internal`` is about the solver, and a
    page shows it on demand.
    """

    key: str
    name: str
    meaning: str
    unit: str
    kind: Literal["settles", "vanishes", "jumps", "internal", "hidden"] = "settles"


QUANTITIES = (
    Quantity("compliance", "work of the loads", "work of the loads, (f, u)", "energy"),
    Quantity("elastic_energy", "elastic energy", "elastic energy, ½ a(u, u)", "energy"),
    Quantity(
        "strain_norm_max", "largest strain", "largest strain |ε(u)| where the limit is kept", "1"
    ),
    Quantity(
        "strain_norm_max_in_cells",
        "largest strain anywhere",
        "largest strain |ε(u)| anywhere",
        "1",
        "hidden",
    ),
    Quantity(
        "overstrain_max", "excess over the limit", "largest |ε(u)|/M − 1 anywhere", "1", "hidden"
    ),
    Quantity(
        "locked_fraction",
        "share at the limit",
        "share of the body that is locked, |ε| ≥ M",
        "1",
        "jumps",
    ),
    Quantity(
        "contact_force", "contact force", "resultant of the contact pressure on the body", "force"
    ),
    Quantity("friction_force", "friction force", "resultant of the friction on the body", "force"),
    Quantity("contact_area", "contact area", "part of Γ_C under pressure", "area", "jumps"),
    Quantity("slip_area", "slip area", "part of Γ_C that slips", "area", "jumps"),
    Quantity(
        "friction_used",
        "friction used",
        "share of the friction bound that acts, over all of Γ_C",
        "1",
        "jumps",
    ),
    Quantity(
        "penetration_max", "penetration", "largest penetration [u_ν − g]⁺", "length", "vanishes"
    ),
    Quantity(
        "iterations.tangents", "tangents", "tangents factorised or preconditioned", "1", "internal"
    ),
    Quantity("wall_seconds", "time", "time of the whole solve", "s", "internal"),
    Quantity(
        "certificate.errors.mesh.relative",
        "mesh error",
        "estimated error of the mesh, relative in the energy norm",
        "1",
        "vanishes",
    ),
    Quantity(
        "certificate.errors.penalty.relative",
        "bound of the penalty's effect",
        "bound of the distance to the solution for n = ∞, relative in the energy norm",
        "1",
        "vanishes",
    ),
    Quantity(
        "certificate.errors.penalty_measured.relative",
        "measured effect of the penalty",
        "measured distance to the solution for n = ∞, relative in the energy norm",
        "1",
        "vanishes",
    ),
    Quantity(
        "certificate.errors.guaranteed.relative",
        "bound of the whole error",
        "proved bound of the error of mesh and penalty, relative in the energy norm, for the "
        "friction bound kept fixed",
        "1",
        "vanishes",
    ),
    Quantity(
        "admissible_load_factor",
        "admissible share of the displacements",
        "between these shares of the prescribed displacements a solution on this mesh ends",
        "1",
        "hidden",
    ),
    Quantity("residual", "residual", "equilibrium residual relative to the forces", "1", "hidden"),
    Quantity(
        "duality_gap",
        "duality gap",
        "duality gap of the last solve, over the energy",
        "1",
        "hidden",
    ),
    Quantity(
        "friction_fixed_point.contraction",
        "contraction factor",
        "factor by which updates of the friction bound shrink",
        "1",
        "hidden",
    ),
    Quantity("discretisation.degree", "degree", "degree of the displacements", "1", "hidden"),
    Quantity(
        "discretisation.limit_at", "limit at", "points of each cell with the limit", "", "hidden"
    ),
    Quantity("dofs", "unknowns", "degrees of freedom", "1", "hidden"),
    Quantity("cells", "cells", "cells of the mesh", "1", "hidden"),
)

#: The meanings of the values of the certificate, by their names.
MEANINGS = {
    "displacement_norm": "‖ε(u)‖ over the body",
    "locking_penalty": "2n ∫ ([|ε| − M]⁺)²",
    "contact_penalty": "(1/ε) ∫ ([u_ν − g]⁺)²",
    "locking_work": "∫ M |Z|, the work of the locking stress at the limit",
    "equilibrium": "residual forces over the forces that act",
    "force_balance": "sum of all forces on the body",
    "moment_balance": "sum of all moments on the body",
    "locking_complementarity": "locking stress only where |ε| = M",
    "locking_violation": "strain beyond the locking law",
    "contact_complementarity": "pressure only where the gap is closed",
    "contact_violation": "penetration beyond the contact law, and pull",
    "held_nodes": "contact forces at nodes that conditions hold",
    "friction_complementarity": "slip only at the friction bound, against the traction",
    "coulomb_cone": "friction above its bound",
    "friction_sign": "work that friction adds",
    "friction_bound": "change of the friction bound in one more update",
    "smoothing_constants": "change of constants by R",
    "duality_gap": "sum of Fenchel's terms of the laws over the work",
    "energy_balance": "energy that a step creates or loses beyond its bounds, over the work",
    "alpha": "smallest eigenvalue of the elasticity",
    "c_0": "trace constant of this mesh, |v| on Γ_C ≤ c_0 ‖v‖_V, from below",
    "friction_coefficient": "largest μ",
    "friction_lipschitz": "Lipschitz constant of μ in the slip",
    "friction_constants": "whether μ and its Lipschitz constant are exact or sampled",
    "smoothing_norm": "upper bound of the norm of R on this mesh",
    "uniqueness.verdict": "whether theory says that there is no other solution",
    "uniqueness.contraction": "factor by which updates of the friction bound shrink",
    "mesh.energy_norm": "estimated distance to the solution on finer meshes",
    "mesh.relative": "the same over the solution",
    "mesh.with_locking": "the same with the locking stress in it",
    "penalty.energy_norm": "bound of the distance to the solution for n = ∞ on this mesh",
    "penalty.relative": "the same over the solution",
    "penalty.displacement_norm": "the same bound in the norm of the strain",
    "load_factor": "shares of the prescribed displacements that can, and cannot, be followed",
    "infeasible": "whether no displacement on any mesh follows the prescribed values",
    "guaranteed.energy_norm": "proved bound of the whole error, for the friction bound kept fixed",
    "guaranteed.relative": "the same over the solution",
    "guaranteed.applicable": "whether the bound is proved for these data",
    "penalty_measured.energy_norm": "measured distance to the solution for n = ∞ on this mesh",
    "penalty_measured.relative": "the same over the solution",
    "penalty_measured.displacement_norm": "the same distance in the norm of the strain",
}


def reactions(summary: Mapping[str, Any]) -> list[tuple[Quantity, Any]]:
    """The reaction of each boundary part with prescribed displacements."""
    found = summary.get("reactions")
    listed = found.items() if isinstance(found, dict) else ()
    meaning = "resultant of the reactions on the body"
    return [
        (Quantity(f"reactions.{name}", f"reaction on {name}", meaning, "force"), value)
        for name, value in listed
    ]


def by_contact(summary: Mapping[str, Any]) -> tuple[list[str], list[tuple[Quantity, list[Any]]]]:
    """The names of the contacts, and each quantity with its values for them; empty for one."""
    listed = summary.get("contacts")
    entries = listed if isinstance(listed, list) and len(listed) > 1 else []
    contacts = [entry if isinstance(entry, dict) else {} for entry in entries]
    return [contact_name(summary, number) for number in range(len(contacts))], [
        (quantity, [contact.get(quantity.key) for contact in contacts])
        for quantity in QUANTITIES
        if any(quantity.key in contact for contact in contacts)
    ]
