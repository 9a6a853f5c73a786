"""What a solve costs: the sizes up to which systems are factorised, and the memory ahead."""
