"""Gross errors, low and high, found before any method of the ground filter runs."""
