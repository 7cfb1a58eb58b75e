"""What the columns of vertices and half-edges mean."""

from __future__ import annotations

#: Columns of vertices: place in steps of the grid, a half-edge that starts there (the first counter-clockwise
#: from −x on, −1 for none), whether all pieces have to meet there in one elevation.
X, Y, EDGE, JOINED = range(4)
#: Columns of half-edges, of which 2k and 2k + 1 are one edge: the vertex where one starts, the piece to its
#: left, the next ones around its start, counter-clockwise and clockwise, and its piece's elevation there.
START, LEFT, CCW, CW, LEVEL = range(5)
