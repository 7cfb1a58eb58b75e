"""Method `morphological`: openings of the lowest surface."""
