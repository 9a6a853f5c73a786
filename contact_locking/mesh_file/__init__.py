"""Mesh files of the user: read in a process of their own, and checked before DOLFINx uses them.

A file may come from anybody: `trusted` decides which files Gmsh may read, `reader` protects this
process from a crash of Gmsh, and `diagnosis` checks the mesh.
"""
