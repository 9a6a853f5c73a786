"""The certificate of a solution: criteria, proved bounds, constants, balances, error estimates."""

from contact_locking.certificate.verdict import Certificate, Extras, certify, is_solved

__all__ = ["Certificate", "Extras", "certify", "is_solved"]
