"""Method `progressive_tin`: a TIN that grows over the terrain."""
