"""Which points lie near each other: grids, neighbours, connected sets, spacings, scan patterns."""
