"""Edge labelling: which roof points lie on edges."""
