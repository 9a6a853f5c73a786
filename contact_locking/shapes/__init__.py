"""The shapes of rigid foundations: each is one class, for scripts and study files."""
