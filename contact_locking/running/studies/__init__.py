"""Studies: one file describes many cases, and a `run` of its own solves each of them.

A hash of its parameters names the folder of a case.  Only the processes of the cases import DOLFINx
and MPI.
"""
