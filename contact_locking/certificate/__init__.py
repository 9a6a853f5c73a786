"""The certificate of a solution: criteria, proved bounds, constants, balances, errors."""
