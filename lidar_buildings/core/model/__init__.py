"""What stages hand on: tiles, outlines, classes, ids, statuses, parameters, errors."""
