"""The results of a solve: their derived fields, and the files that hold them."""
