"""A result in a window or as a picture by Open3D: `parts` says what is drawn, `drawing` draws it."""

#: What the roofs of models and points can be coloured by.
OF_ROOFS = ("type", "slope")
OF_POINTS = ("class", "height", "intensity", "building", "plane", "edge")
NOTHING = "none"
#: Where the eye can be: clockwise from north every 45°, or straight above.
SIDES = ("north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest")
ABOVE = "above"
