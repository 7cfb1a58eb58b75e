"""Given footprints instead of traced outlines: repaired, numbered, and the points of each."""
