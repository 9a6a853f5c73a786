"""A guaranteed bound of the error by an exactly equilibrated stress, in two dimensions."""

from contact_locking.certificate.guaranteed.energy_bound import guaranteed_error

__all__ = ["guaranteed_error"]
