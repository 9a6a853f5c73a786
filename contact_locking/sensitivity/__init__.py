"""How quantities of a solution change with the numbers that the problem is made of."""
