"""The kinds of bodies, on which the sizes of tensors depend."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BodyKind:
    """The body as far as the sizes of tensors depend on it; ``str`` tells it in words."""

    dim: int
    axisymmetric: bool = False
    plane_stress: bool = False
    elastic_limits: bool = False

    def __str__(self) -> str:
        return "for an axisymmetric body" if self.axisymmetric else f"in {self.dim}D"

    @property
    def strains(self) -> int:
        """The number of normal strains."""
        return 3 if self.axisymmetric else self.dim

    @property
    def components(self) -> int:
        """The number of components of Mandel vectors."""
        return 4 if self.axisymmetric else self.dim * (self.dim + 1) // 2
