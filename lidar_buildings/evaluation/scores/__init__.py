"""How well a result agrees with a reference: points, cells and outlines."""
