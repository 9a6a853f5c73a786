"""What a user can trust a run by: proved bounds, constants, balances and error estimates."""

from contact_locking.certificate.verdict import Certificate, certify, is_solved

__all__ = ["Certificate", "certify", "is_solved"]
