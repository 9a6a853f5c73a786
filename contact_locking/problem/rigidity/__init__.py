"""The rigid motions of the body: which of them conditions, contact and friction stop."""
