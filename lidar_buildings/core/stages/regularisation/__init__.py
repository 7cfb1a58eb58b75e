"""Regularisation: straight walls, right angles and arcs from a traced outline."""
