"""Results and references as files hold them, read for scoring."""
