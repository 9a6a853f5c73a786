"""Files and folders: written whole or not at all, and used by one run at a time."""
