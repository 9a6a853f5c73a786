"""Measured memory and times of solves, from which the estimate of others is scaled."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Growth:
    """``linear N + factor N^power`` for N unknowns."""

    linear: float
    factor: float = 0.0
    power: float = 1.0

    def __call__(self, size: float) -> float:
        return self.linear * size + self.factor * size**self.power


@dataclass(frozen=True)
class Reference:
    """Constants of the estimate, in seconds and bytes, by dimension where they depend on it.

    Measured on one core of a Xeon (AVX-512, 2 cores) with DOLFINx 0.9, OpenBLAS and CHOLMOD: the
    block of the tests at n = .inf with h = 1/64 to 1/256 in 2D and 1/12 to 1/24 in 3D, and with
    h = 1/32 to 1/64 in 3D for iterative solves (docs/benchmarks.md); numbers of tangents and
    times of small solves are those of the demos.  docs/guides/large.md compares the estimate with
    what other solves took.
    """

    #: A process before its first tangent: imports, and compiled forms that are loaded.
    start: float = 0.5
    #: A step beside its tangents: fields, certificate and files.
    step: float = 0.1
    #: A tangent beside what grows with the unknowns.
    tangent: float = 0.005

    #: Tangents of a solve, and of a step after another step.
    tangents: float = 17.0
    tangents_of_step: float = 13.0
    #: As many times the tangents: with whole solves for one friction bound after the other, with
    #: only contact or only a limit, and with neither.
    nested: float = 8.0
    simple: float = 0.7
    linear: float = 0.15

    #: Seconds of a tangent that is factorised; the exponents are those of nested dissection.
    direct_2d: Growth = Growth(4.1e-6, 3.4e-9, 1.5)
    direct_3d: Growth = Growth(1.08e-5, 4.5e-10, 2.0)
    #: Seconds of a tangent by GMRES, beside the factor of the filter, and of its set-up.
    iterative_2d: Growth = Growth(1.2e-5)
    iterative_3d: Growth = Growth(1.2e-5)
    set_up: float = 0.3
    #: Seconds of a tangent by GMRES where more is locked than the filter takes: by projection, and
    #: by multigrid alone where n bounds the contrast.
    projected_3d: Growth = Growth(0.0, 6.3e-8, 1.5)
    alone_3d: Growth = Growth(0.0, 2.6e-6, 1.2)
    #: The share of the unknowns that the filter beside GMRES factorises, as the block has it.
    filtered: float = 0.65
    #: The rows of the projection, which takes the place of a filter that is too large, over the
    #: unknowns.
    projected: float = 0.36
    #: The largest iterative solve that was measured, in unknowns.
    largest: float = 8.3e5

    #: Bytes of a rank with all libraries, of an unknown, and of the factor.
    rank: float = 0.23e9
    memory_2d: Growth = Growth(1.6e3)
    memory_3d: Growth = Growth(6.9e3)
    factor_2d: Growth = Growth(1.6e3)
    factor_3d: Growth = Growth(0.0, 145.0, 4 / 3)
    #: More bytes of an unknown where multigrid works alone: GMRES has a vector for each iteration.
    kept_alone: float = 3.0e3
    #: The factor in pieces on several ranks, relative to that on one rank.
    in_pieces: float = 2.0

    #: Of the speed of several ranks, the share that they reach; more ranks than `direct_ranks`
    #: make direct solves no faster.
    efficiency: float = 0.85
    direct_ranks: int = 2

    #: CPU seconds of the pieces of work that the probe does on this machine.
    product: float = 1.0e-3
    gather: float = 1.1e-3


REFERENCE = Reference()
