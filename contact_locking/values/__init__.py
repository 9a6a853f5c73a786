"""What concepts are made of: their base class, and the kinds of their values."""
