"""A sweep over problems that nobody designed: families of random studies, solved and judged."""
