"""Mesh files of the user's: read in a process of their own, and diagnosed before DOLFINx sees them.

Files come from anybody: see `trusted` for what may reach Gmsh, `reader` for what happens if Gmsh
crashes, and `diagnosis` for what a mesh has to be.
"""
