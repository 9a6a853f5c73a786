"""Mesh files of the user: read in a process of their own, and checked before DOLFINx uses them.

A file may come from anybody: `reader` decides which files Gmsh may read, and protects this process
from a crash of Gmsh; `diagnosis` checks the mesh.
"""
