"""``python -m contact_locking`` is ``contact-locking``."""

import sys

from contact_locking.command.cli import main

sys.exit(main())
