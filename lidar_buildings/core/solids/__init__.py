"""Closed shells, how they are raised from roofs, and whether they are valid."""
