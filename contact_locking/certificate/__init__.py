"""What a user can trust a run by: proved bounds, constants, balances and error estimates."""

from contact_locking.certificate.certify import Certificate, certify

__all__ = ["Certificate", "certify"]
