"""A wing: pictures, charts and pages of results."""

from contact_locking import wings

wings.FILES.add(f"{__name__}.pictures:pictures")
