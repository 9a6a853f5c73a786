"""All families of the sweep by name, and the case of a seed."""

from __future__ import annotations

import dataclasses
import math
import zlib

from . import blocks, frictions, materials, processes, shapes, supports, unseen
from .case import FAMILIES, Case, Random
from .pairs import PAIRS, pairs

__all__ = ["FAMILIES", "MODULES", "PAIRS", "case_of"]

MODULES = (blocks, frictions, materials, processes, shapes, supports, unseen)


def case_of(name: str, seed: int, linear: str = "auto", n: float | None = None) -> Case:
    """The case of a family for a seed: the same on every machine and in every order.

    ``linear`` is the linear solver of the studies, and ``n`` the penalty in place of their own; a
    problem of pairs has its own.
    """
    random = Random.of(zlib.crc32(name.encode()), seed)
    if name == PAIRS:
        # The seed is the number of a row as well.
        return pairs(random, seed)
    case = FAMILIES[name](random)
    if linear != "auto":
        case.study.setdefault("solver", {})["linear"] = linear
    if n is not None:
        case.study["penalty"] = {"n": n}
    if n is not None and math.isfinite(n):
        # A penalty lets sticking points slip a little, too.
        case = dataclasses.replace(case, truth=dataclasses.replace(case.truth, slip=None))
    return case
