"""A wing: pictures, charts and pages of results."""

from contact_locking import wings

wings.PICTURES.add(f"{__name__}.pictures:pictures")
