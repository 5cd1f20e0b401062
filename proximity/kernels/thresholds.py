"""Sizes and tolerances used by both Python and kernels."""

MAX_COORDINATE = 1e150
SMALLEST_SIZE = 1e-150
"""m; fourth powers stay within float64."""
MILLIMETRES_FROM, MILLIMETRES_TO = 100.0, 10_000.0
"""Range of distances, in sizes of the scene, that suggest points given in millimetres. Such points are a
thousand times too far: some hundreds of sizes if they are near the scene, some thousands otherwise."""
SORT_FROM = 48
"""Size of a batch from which on its points are walked along a space-filling curve, each starting from its
neighbour's answer. Sorting costs some 20 ns a point and saves a third of the walk."""
VOLUME_ROUNDING = 64.0 * 2.0**-52
"""A volume below this times area and reach is lost in the rounding of its coordinates, and counts as zero."""
CONTACT_DEPTH = 1e-10
"""Least distance, in sizes of the part, of an edge's two ends from a face on opposite sides for the edge to
cross it; an edge with both ends nearer counts as coplanar. Faces thinner than this are degenerate."""
SMALLEST_SHARE = 2.0**-8
"""A part smaller than this share of a shared frame gets a separate frame, for tight boxes."""
OBLIQUE = 0.8
"""Oriented boxes are tested if their surface is at most this share of that of axis-aligned ones. On a plate
with axis-aligned holes they would reject one block in eight, and cost more than that saves."""
MOVING_MARGIN = 0.25
"""Initial share of the scene's frame that its parts occupy: the rest lets them move before it must change."""
SMALLEST_REACH = MOVING_MARGIN / 16.0
"""Below this share of the scene's frame the parts have coarse boxes."""
SORT_STEPS = 8
"""Steps per dynamic part that repair the order at a move. Any order is correct; a good one is fast."""
