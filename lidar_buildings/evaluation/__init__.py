"""Results beside references: scores and the score command."""
