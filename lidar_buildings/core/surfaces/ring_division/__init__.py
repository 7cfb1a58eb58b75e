"""Where rings and open chains of points turn: their division into straight walls and arcs."""
