"""
The ground filter: which points are ground, and how high above it the others are.

`classification` is the stage. `gross_errors` runs first, then one of the methods: `progressive_tin` (on
`tin_growth` and `landforms`), `bidirectional_slope` (on `scan_profiles`), or all in `consensus`.
"""
