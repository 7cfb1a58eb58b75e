"""
The ground filter: which points are ground, and how high above it the others are.

`classification` is the stage; `gross_errors` runs first; then one of the methods: `growing_tin`
(``progressive_tin``), `scan_profiles` (``bidirectional_slope``), `morphological`; or all three, of which
`consensus` takes the majority.
"""
