"""Files that appear complete or not at all, and folders for one run at a time."""
