"""Pictures and reports, which are made from solutions and results; no solve needs them."""
