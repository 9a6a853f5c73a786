"""The mesh of the body: read, checked, distributed, with named parts."""
