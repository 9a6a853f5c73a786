"""The sizes up to which linear systems are factorised, and the memory that this takes."""

from __future__ import annotations

# Above these many unknowns, by dimension, GMRES takes over; below, the direct solver is as fast or
# nearly so, and it never fails.  In 3D they are even at 25 000, and at 110 000 GMRES takes half the
# time.
DIRECT_LIMIT = {2: 1_000_000, 3: 50_000}
# So many unknowns are filtered at most, by dimension and degree of the elements.  With linear
# elements in 3D a filter of 70 000 unknowns takes as long as the projection, and with 130 000 it
# takes longer.  With quadratic elements the projection takes several times as long as the filter;
# beyond this limit the filter's memory would be that of the whole solve again.
FILTER_LIMIT = {(2, 1): 1_000_000, (2, 2): 1_000_000, (3, 1): 100_000, (3, 2): 300_000}
# Bytes, measured with DOLFINx 0.9, OpenBLAS and CHOLMOD: of a rank with all libraries; of an
# unknown in 2D with its factor, and in 3D without; and in 3D of the factor, which grows like a
# power of the unknowns, and of an unknown in place of the factor beside GMRES.
_RANK, _UNKNOWN, _FACTOR, _ITERATIVE = 0.23e9, {2: 3.2e3, 3: 5.6e3}, (145.0, 4 / 3), 5.5e3


def chosen(linear: str, dim: int, size: int) -> str:
    """The name that ``linear`` stands for: auto is direct or iterative, by dimension and size.

    ``size`` are the unknowns of a cube that takes as long to factorise.
    """
    if linear != "auto":
        return linear
    return "direct" if size <= DIRECT_LIMIT[dim] else "iterative"


def estimated_memory(linear: str, dim: int, unknowns: int, size: int, ranks: int) -> float:
    """About the bytes that a solve takes on all ranks together; ``size`` as in `chosen`.

    Nobody knows before the solve how much of the body locks.
    """
    memory = ranks * _RANK + _UNKNOWN[dim] * unknowns
    if dim == 2:
        return memory
    if chosen(linear, dim, size) == "iterative":
        return memory + _ITERATIVE * unknowns
    coefficient, power = _FACTOR
    # A factor in pieces on several ranks takes twice the memory.
    return memory + (2.0 if ranks > 1 else 1.0) * coefficient * size**power
