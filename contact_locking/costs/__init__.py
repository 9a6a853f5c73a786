"""What a solve costs: the sizes up to which systems are factorised, memory and time ahead."""
