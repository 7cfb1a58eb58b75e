"""Façades: walls as they are seen from the street, told from fences, hedges and vehicles."""
