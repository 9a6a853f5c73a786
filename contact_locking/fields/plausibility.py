"""Warnings about data and results that are possible but probably not intended."""

from __future__ import annotations

from collections.abc import Sequence

from contact_locking.plain_text import coordinates

# The theory neglects squares of the displacement gradient: a tenth of a strain of this size, and of
# a rotation its half square.  Strains above 1 come from a mistake.
_LARGE_STRAIN, _LARGE_ROTATION, _ABSURD_STRAIN = 0.1, 0.1, 1.0
# A warning gives a larger excess as a multiple and a smaller excess in per cent.
_MULTIPLE = 10.0
# The share of violation by a penalty that causes a warning, and the share that the advice aims at.
_NOTABLE, _AIM = 0.1, 0.01
# So much of the limit may be exceeded between the points where an element keeps it.
_BETWEEN = 0.05
# Pressure concentrates at edges, where the compliance of the body is this share of length over
# Young's modulus.
_CONCENTRATED = 0.2
# Normals may be off by this share of the friction coefficient.
_TURNS = 0.1


def about_the_strain(largest: float) -> list[str]:
    """A warning about strains too large for the theory of small strains."""
    # The strain may be at a limit of this size, to the tolerance of the solver.
    if largest <= _LARGE_STRAIN * (1.0 + 1e-6):
        return []
    why = f"stresses there are uncertain by about {100.0 * largest:.0f} %"
    if largest > _ABSURD_STRAIN:
        why = (
            "do the units of loads, elasticity and lengths agree, and do displacement conditions "
            "or contact hold the body?"
        )
    return [f"the largest strain is {largest:.3g}, and this theory is of small strains: {why}"]


def about_the_rotation(angle: float, place: Sequence[float] | None, strain: float) -> list[str]:
    """A warning about rotations whose half square is not small beside the largest strain.

    ``angle`` is the largest rotation, at ``place``.
    """
    neglected = 0.5 * angle**2
    if place is None or angle <= _LARGE_ROTATION or neglected <= _NOTABLE * strain:
        return []
    at = ", ".join(f"{x:.3g}" for x in place)
    return [
        f"the body turns by {angle:.2g} rad near ({at}), and this theory is of small rotations: it "
        f"neglects strains of {neglected:.2g}, half of the square, beside the largest strain of "
        f"{strain:.2g}; take a smaller load, or a program for large rotations"
    ]


def about_the_overstrain(overstrain: float, n: float, young: float) -> list[str]:
    """A warning about a penalised strain that exceeds its limit by a large share of M.

    ``overstrain`` is the largest ``|eps|/M - 1 = |Z|/(2 n M)`` (23).  The advised n assumes that
    the stiffer penalty bears the same Z or, if this is more, the present stress of the material.
    """
    if overstrain <= _NOTABLE:
        return []
    size = f"exceeds its limit by up to {100.0 * overstrain:.0f} %"
    if overstrain >= _MULTIPLE:
        size = f"is up to {1.0 + overstrain:.3g} times its limit"
    better = max(n, 0.5 * young) * overstrain / _AIM
    return [
        f"the strain {size}: penalty.n: {better:.1e} leaves about "
        f"{100.0 * _AIM:.0f} %, and .inf nothing; if that hardly helps, no displacement on this "
        "mesh within the limit can follow the prescribed ones, which .inf would report"
    ]


def about_strains_between_points(at_points: float, anywhere: float) -> list[str]:
    """A warning about strains that exceed the limit where the element does not keep it.

    Both are the largest ``|eps|/M``, at the points where the element keeps the limit and anywhere.
    """
    if anywhere - max(at_points, 1.0) <= _BETWEEN:
        return []
    return [
        f"the strain is up to {100.0 * anywhere:.0f} % of its limit between the points of a cell "
        "where the element keeps the limit; a finer mesh brings this nearer to 100 %"
    ]


def about_held_nodes(
    keys: Sequence[str], penetrations: Sequence[float], displacement: float
) -> list[str]:
    """Warnings about foundations that enter the body where prescribed displacements hold it.

    ``keys`` are the keys of the contacts, ``penetrations`` the largest ``[u_nu - gap]^+`` at their
    nodes that cannot give way, and ``displacement`` is the largest ``|u|``.
    """
    return [
        f"{key}: the foundation enters the body by {penetration:.3g} at nodes that "
        "loads.displacements holds, where no contact acts; end contact.on, or the foundation, "
        "before the part that is held"
        for key, penetration in zip(keys, penetrations, strict=True)
        if penetration > _NOTABLE * displacement
    ]


def about_an_entry(key: str, depth: float, share: float, place: Sequence[float]) -> list[str]:
    """A warning about a foundation that enters between the nodes of Gamma_C.

    ``depth`` is how deep it enters, ``share`` the depth as a share of its indentation, and
    ``place`` where.
    """
    if share <= _NOTABLE:
        return []
    at = coordinates(place)
    return [
        f"{key}: between the nodes near ({at}) the foundation enters the body by {depth:.3g}, "
        f"{100.0 * share:.0f} % of its indentation; the conditions of contact hold at the nodes "
        "alone: take smaller cells there, or a rounder foundation"
    ]


def about_uncovered_boundary(
    key: str, depth: float, place: Sequence[float], displacement: float
) -> list[str]:
    """A warning about a boundary outside of Gamma_C that enters the foundation of a contact.

    ``depth`` is how deep the moved boundary enters, ``place`` where, and ``displacement`` is the
    largest ``|u|``.
    """
    if depth <= _NOTABLE * displacement:
        return []
    at = coordinates(place)
    return [
        f"{key}: the boundary outside of {key}.on enters the foundation by {depth:.3g} near "
        f"({at}), where no contact acts; add the boundary part there to {key}.on, unless the "
        "foundation ends before"
    ]


def about_the_normals(key: str, turn: float, friction: float) -> list[str]:
    """A warning about normals that turn by much of the friction coefficient, with ``pair: once``.

    ``turn`` is the largest angle, and ``friction`` the least coefficient where bodies press.
    """
    if not turn > _TURNS * friction:
        return []
    return [
        f"{key}: the normals of the bodies where they press are {turn:.2g} rad off those of the "
        f"undeformed mesh, which counts beside the friction coefficient {friction:.3g}; leave out "
        "pair: once"
    ]


def about_the_sliding(key: str, slid: float, facet: float) -> list[str]:
    """A warning about bodies that slide farther than the points that face each other allow.

    ``slid`` is how far they have slid since they were paired, and ``facet`` is the length of a
    facet of side 2.
    """
    if slid <= facet:
        return []
    return [
        f"{key}: the bodies slide by {slid:.3g} along each other, {slid / facet:.2g} facets of "
        "against, and the points that face each other are those of the undeformed mesh: leave out "
        "pair: once"
    ]


def about_the_penetration(
    penetration: float, displacement: float, epsilon: float, soft: float, follows_n: bool
) -> list[str]:
    """A warning about a body that enters the foundation by a large share of its displacement.

    ``penetration`` is ``max [u_nu - gap]^+ = eps p`` (25), and ``displacement`` is the largest
    ``|u|``.  ``soft`` is the compliance of the body, length over Young's modulus.  ``follows_n``
    says that epsilon is 1/n.
    """
    if epsilon == 0.0 or penetration <= _NOTABLE * displacement:
        return []
    share = penetration / displacement
    better = _AIM * min(epsilon / share, _CONCENTRATED * soft)
    key, value = ("penalty.n", 1.0 / better) if follows_n else ("penalty.epsilon", better)
    return [
        f"the body enters the foundation by {100.0 * share:.0f} % of its largest displacement: "
        f"{key}: {value:.1e} leaves about {100.0 * _AIM:.0f} %, and penalty.n: .inf "
        "without an epsilon nothing"
    ]
