"""The mesh builders by name: geometries that Gmsh meshes.

A geometry is a frozen dataclass that checks its parameters without Gmsh. Gmsh meshes it in

    with build(BUILDERS["block"](h=0.05)) as model: ...

on one process, where `model` is ``gmsh.model`` with the physical groups that the class names.
"""

from .block import Block, Inclusion, LShape, Punch, Stack
from .geometry import Geometry, build, empty_model, write
from .grains import Grains
from .round import Annulus, Ball, Disc, DiscInRing, Grip

BUILDERS: dict[str, type[Geometry]] = {
    "block": Block,
    "punch": Punch,
    "disc": Disc,
    "ball": Ball,
    "annulus": Annulus,
    "l_shape": LShape,
    "inclusion": Inclusion,
    "stack": Stack,
    "disc_in_ring": DiscInRing,
    "grains": Grains,
    "grip": Grip,
}

__all__ = ["BUILDERS", "Geometry", "build", "empty_model", "write"]
