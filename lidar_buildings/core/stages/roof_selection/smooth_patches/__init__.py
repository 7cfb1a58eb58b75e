"""
Method ``smooth_patches``, the default: `roofs` has the steps, in the order of the other modules below.

`roof_patches` starts roofs (but for `decks`; by `plane_votes` where points are few),
`narrow_parts` and `attached_parts` drop what is too narrow, `rims` what has no
end; `wet_roofs` adds roofs of which only the rims came back. `walls` tells those as large as a building's.
"""
