"""The quantities of a solution, each with its name, meaning and unit, and how it is computed.

The summary, history.csv, the terminal, reports, pictures and the reference of the documentation use
this registry.  It does not import DOLFINx, so that reports do not need it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from contact_locking.arrays import AXES, FloatArray, moments
from contact_locking.results.contact_points import OPEN, SLIP

if TYPE_CHECKING:
    from contact_locking.results.derived import BodyFields, ContactFields, Contacts

Of = Literal["body", "contact", "certificate", "solver"]

# A moment below this share of the moments that it is the sum of is rounding, and so is a coordinate
# below this share of the largest.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Quantity:
    """A number or a vector of summary.json.

    - ``key``, ``name``, ``meaning``, ``unit``: the dotted key, and texts
    - ``compute``, ``of``: maps the fields of the body or the contacts to the value; None for
      values of the solver or the certificate
    - ``at``: a preposition, if the value has a place, which the summary has as ``<key>_at``
    - ``share_of``: what it is a share of, printed in per cent
    - ``beside``: another quantity, without which this one is not printed
    - ``detail``: folded in reports, and not printed in the terminal
    - ``derives``: has derivatives (`contact_locking.inverse.quantities`)
    - ``is_place``: coordinates or None, with columns for all axes in history.csv
    - ``is_resultant``: of several contacts only those with foundations count
    - ``trend``: a study plots differences with a rate (settles), a rate (vanishes), counts (jumps)
    """

    key: str
    name: str
    meaning: str
    unit: str
    compute: Callable[[Any], Any] | None = None
    of: Of = "solver"
    trend: Literal["settles", "vanishes", "jumps"] | None = "settles"
    at: str = ""
    share_of: str = ""
    detail: bool = False
    beside: str = ""
    derives: bool = False
    is_place: bool = False
    is_resultant: bool = False


def touches(fields: ContactFields) -> FloatArray:
    """1 at the nodes (k,) where the body touches, 0 at the others."""
    return (fields.state != OPEN).astype(float)


#: The quantities by key, in the order of the output.
QUANTITIES: dict[str, Quantity] = {}


def quantity(of: Of, name: str, unit: str, **others: Any) -> Callable[[Any], Any]:
    """Register a collective function: its name is the key, and its docstring the meaning.

    Its argument is `BodyFields`, or `Contacts`: all of them for the summary, and one for an entry
    of ``contacts``.  With ``at`` it returns the value and its place, or None.
    """

    def register(compute: Any) -> Any:
        key, words = compute.__name__, " ".join((compute.__doc__ or "").split()).rstrip(".")
        meaning = words[:1].lower() + words[1:]
        QUANTITIES[key] = Quantity(key, name, meaning, unit, compute, of, **others)
        return compute

    return register


@quantity("body", "largest displacement", "length", at="at")
def displacement_max(body: BodyFields) -> Any:
    """Largest |u| at the nodes."""
    return body.peak(body.displacement)


@quantity("body", "largest von Mises stress", "stress", at="at")
def von_mises_max(body: BodyFields) -> Any:
    """Largest von Mises stress, of the elastic and the locking stress together."""
    return (None, None) if body.von_mises is None else body.peak(body.von_mises)


@quantity("contact", "peak pressure", "stress", at="at", derives=True)
def pressure_max(contacts: Contacts) -> Any:
    """Largest contact pressure −σ_ν."""
    return contacts.peak(lambda fields: fields.pressure)


@quantity("contact", "contact force", "force", derives=True, is_resultant=True)
def contact_force(contacts: Contacts) -> Any:
    """Resultant of the contact pressure on the body."""
    dim = contacts.domain.dim
    return contacts.integral(lambda fields: -fields.pressure[:, None] * fields.normal, dim)


@quantity("contact", "friction force", "force", derives=True, is_resultant=True)
def friction_force(contacts: Contacts) -> Any:
    """Resultant of the friction on the body."""
    return contacts.integral(lambda fields: fields.traction, contacts.domain.dim)


@quantity("contact", "friction used", "1", trend="jumps", share_of="the friction bound")
def friction_used(contacts: Contacts) -> Any:
    """∫ |σ_τ| / ∫ G, the share that acts of what friction could hold: 1 if all of it is used."""
    bound = contacts.integral(lambda fields: fields.bound * fields.free)
    size = contacts.integral(lambda fields: np.linalg.norm(fields.traction, axis=1) * fields.free)
    return size / bound if bound > 0.0 else None


def _mean_place(
    contacts: Contacts, weight: Callable[[ContactFields], FloatArray], total: float
) -> FloatArray:
    """``int w x / int w`` (d,) of weights (k,) at the nodes with the integral ``total``."""
    dim, size = contacts.domain.dim, np.abs(contacts.domain.bounding_box).max()
    mean = contacts.integral(lambda f: weight(f)[:, None] * f.surface.points, dim) / total
    return np.where(np.abs(mean) <= _ROUNDING * size, 0.0, mean)


@quantity("contact", "contact moment", "force · length", at="about", is_resultant=True)
def contact_moment(contacts: Contacts) -> Any:
    """Moment of pressure and friction on the body, about the centre of where it touches."""
    dim, area = contacts.domain.dim, contact_area(contacts)
    if not area > 0.0 or contacts.domain.axisymmetric:
        return np.zeros(3 if dim == 3 else ()), None
    centre = _mean_place(contacts, touches, area)

    def each(fields: ContactFields) -> FloatArray:
        forces = fields.traction - fields.pressure[:, None] * fields.normal
        return moments(fields.surface.points - centre, forces)

    total = contacts.integral(each, 2 * dim - 3)
    size = contacts.integral(lambda fields: np.linalg.norm(each(fields), axis=1))
    total[np.abs(total) <= _ROUNDING * size] = 0.0
    return total if dim == 3 else total[0], centre


@quantity("contact", "centre of pressure", "length", trend=None, is_place=True, is_resultant=True)
def pressure_centre(contacts: Contacts) -> Any:
    """∫ p x / ∫ p, the mean place of the contact pressure p."""
    total = contacts.integral(lambda fields: fields.pressure)
    if not total > 0.0 or contacts.domain.axisymmetric:
        return None
    return _mean_place(contacts, lambda fields: fields.pressure, total)


@quantity("contact", "contact area", "area", trend="jumps")
def contact_area(contacts: Contacts) -> Any:
    """Part of Γ_C where the body touches, a length in 2D."""
    return contacts.integral(touches)


@quantity("contact", "slip area", "area", trend="jumps", beside="friction_used")
def slip_area(contacts: Contacts) -> Any:
    """Part of Γ_C where the body slips, a length in 2D."""
    return contacts.integral(lambda fields: (fields.state == SLIP).astype(float))


@quantity("contact", "largest slip", "length", detail=True)
def slip_max(contacts: Contacts) -> Any:
    """Largest accumulated slip of the points that touch."""
    return contacts.peak(lambda fields: fields.slip * touches(fields))[0]


@quantity("contact", "largest slip of the step", "length", trend=None, detail=True)
def slip_step_max(contacts: Contacts) -> Any:
    """Largest slip of the last step, of the points that touch."""
    return contacts.peak(lambda f: np.linalg.norm(f.increment, axis=1) * touches(f))[0]


@quantity("contact", "penetration", "length", trend="vanishes", detail=True)
def penetration_max(contacts: Contacts) -> Any:
    """Largest [u_ν − g]⁺ at the nodes, held nodes included."""
    return contacts.peak(lambda fields: fields.u_normal - fields.gap)[0]


@quantity("contact", "penetration between nodes", "length", trend=None, detail=True)
def penetration_between_nodes(contacts: Contacts) -> Any:
    """How deep the foundation enters between the nodes, beyond the depth at the nodes."""
    return max((fields.entry.depth for fields in contacts.fields), default=0.0)


@quantity("body", "largest strain", "1")
def strain_norm_max(body: BodyFields) -> Any:
    """Largest |ε(u)| at the points where its limit is kept."""
    return body.largest(body.strain_norm)


@quantity("body", "largest strain anywhere", "1", trend=None, detail=True)
def strain_norm_max_in_cells(body: BodyFields) -> Any:
    """Largest |ε(u)| anywhere."""
    return body.peaks[0]


@quantity("body", "largest rotation", "1", trend=None, at="at", detail=True)
def rotation_max(body: BodyFields) -> Any:
    """Largest angle |skew ∇u|/√2, in radians, at the points of the strains."""
    return body.peak(body.rotation)


@quantity("body", "excess over the limit", "1", trend=None, detail=True)
def overstrain_max(body: BodyFields) -> Any:
    """Largest |ε(u)|/M − 1 anywhere, at least 0; the largest of all sets of strains."""
    return max(body.peaks[1] - 1.0, 0.0)


@quantity("body", "strain limit used", "1", trend="jumps", share_of="the limit")
def limit_used(body: BodyFields) -> Any:
    """Largest |ε(u)|/M at the points where the element keeps it; the largest of all sets."""
    return body.largest(body.strain_norm, body.locking_limit) if body.is_limited else None


@quantity(
    "body",
    "locked",
    "1",
    trend="jumps",
    share_of="the body is at its strain limit",
    beside="limit_used",
)
def locked_fraction(body: BodyFields) -> Any:
    """Share of the volume with |ε| ≥ M (1 − 1e-6), or where another set of strains is used up."""
    return body.share(body.locked.x.array)


@quantity("body", "work of the loads", "energy", detail=True, derives=True)
def compliance(body: BodyFields) -> Any:
    """(f, u), the work of body force, tractions, pressures and forces."""
    return body.system.compliance()


@quantity("body", "elastic energy", "energy", detail=True, derives=True)
def elastic_energy(body: BodyFields) -> Any:
    """½ a(u, u), or ½ ∫ A(ε − ε₀) : (ε − ε₀) with an eigenstrain ε₀, and the energy of springs."""
    return body.system.elastic_energy()


def _error(key: str, name: str, meaning: str) -> Quantity:
    key, meaning = f"certificate.errors.{key}.relative", f"{meaning}, relative in the energy norm"
    return Quantity(key, name, meaning, "1", of="certificate", trend="vanishes")


_PROVED = "proved bound of the error of mesh and penalty, for the friction bound kept fixed"
_TO_LIMIT = "distance to the solution for n = ∞"
_ELSEWHERE = (
    _error("mesh", "mesh error", "estimated error of the mesh"),
    _error("penalty", "bound of the penalty's effect", f"bound of the {_TO_LIMIT}"),
    _error("penalty_measured", "measured effect of the penalty", f"measured {_TO_LIMIT}"),
    _error("guaranteed", "bound of the whole error", _PROVED),
    Quantity("iterations.tangents", "tangents", "factorised or preconditioned", "1", trend="jumps"),
    Quantity("wall_seconds", "time", "time of the whole solve", "s", trend="jumps"),
)
QUANTITIES |= {entry.key: entry for entry in _ELSEWHERE}


def computed(of: Of, fields: BodyFields | Contacts) -> dict[str, Any]:
    """The quantities of the body or of some contacts, for summary.json; collective."""
    values: dict[str, Any] = {}
    for key, quantity in QUANTITIES.items():
        if quantity.compute is not None and quantity.of == of:
            value = quantity.compute(fields)
            for name, number in zip(
                (key, f"{key}_at"), value if quantity.at else (value,), strict=False
            ):
                values[name] = np.asarray(number).tolist()
    return values


def of_result(contacts: Sequence[str], units: Mapping[str, str]) -> dict[str, Quantity]:
    """The quantities of a result whose contacts have these names, by key, with labels of units.

    Of several contacts each has its own: ``contacts.NAME.pressure_max`` for ``pressure_max``.
    """
    quantities: dict[str, Quantity] = {}
    for key, quantity in QUANTITIES.items():
        labelled = replace(quantity, unit=units.get(quantity.unit, quantity.unit))
        if quantity.of == "contact" and len(contacts) > 1:
            for name in contacts:
                of_contact = replace(
                    labelled, key=f"contacts.{name}.{key}", name=f"{quantity.name} on {name}"
                )
                quantities[of_contact.key] = of_contact
        else:
            quantities[key] = labelled
    return quantities


def columns(values: Mapping[str, Any], dim: int, ending: str = "") -> dict[str, float]:
    """The columns of history.csv for the computed quantities of a summary or of a contact."""
    row: dict[str, float] = {}
    for key, quantity in QUANTITIES.items():
        if quantity.compute is not None and key in values:
            value = [math.nan] * dim if quantity.is_place and values[key] is None else values[key]
            if not (quantity.is_resultant and value is None):
                row |= components(f"{key}{ending}", value)
    return row


def components(name: str, value: Any) -> dict[str, float]:
    """A column for a number, NaN for one that is not known, or one for each axis of a vector."""
    if isinstance(value, list):
        return {f"{name}_{axis}": component for axis, component in zip(AXES, value, strict=False)}
    return {name: math.nan if value is None else value}


def by_name(entries: Sequence[Any]) -> dict[str, Any]:
    """The mappings of a list by their names; empty if they have none."""
    return {
        entry["name"]: entry for entry in entries if isinstance(entry, dict) and "name" in entry
    }


def look_up(data: Any, dotted: str) -> Any:
    """The value of mappings and lists, or of the row of a study, under a dotted key; or None.

    An entry of a list goes by its number from 0, or by its ``name``.
    """
    if isinstance(data, Mapping) and dotted in data:
        return data[dotted]
    for name in dotted.split("."):
        if isinstance(data, list):
            data = {str(number): entry for number, entry in enumerate(data)} | by_name(data)
        data = data.get(name) if isinstance(data, Mapping) else None
    return data
