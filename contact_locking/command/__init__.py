"""The command line, ``contact-locking``: nothing else in this package imports it."""
