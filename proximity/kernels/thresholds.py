"""Sizes and tolerances that Python and kernels compare with, or that Python hands to kernels."""

LARGEST_COORDINATE = 1e150
SMALLEST_SIZE = 1e-150
"""m; squares of squares must stay within float64."""
MILLIMETRES_FROM, MILLIMETRES_TO = 100.0, 10_000.0
"""Sizes of the scene. Points that are given in millimetres are a thousand times as far away: some hundreds of
its sizes where they are near the scene, some thousands where they are not."""
SORT_FROM = 48
"""Points from which on a batch is walked along a space-filling curve: each point then starts from its
neighbour's answer. Sorting costs some 20 ns a point and saves a third of the walk."""
VOLUME_ROUNDING = 64.0 * 2.0**-52
"""A volume is zero when it drowns in the rounding of its coordinates; times area and reach."""
CONTACT_DEPTH = 1e-10
"""Distance that the ends of an edge must have from a face, to both sides, in sizes of the part, for the edge
to pass through; an edge of which both are nearer lies in its plane. What is thinner is no face."""
SMALLEST_SHARE = 2.0**-8
"""A part that is smaller than this share of a shared frame gets a frame of its own, for tight boxes."""
OBLIQUE = 0.8
"""From this share of the surface of boxes along the axes down, oriented ones are worth a look. On a plate
with holes, all in line with the axes, they refuse one block in eight, and cost more than that saves."""
MOVING_MARGIN = 0.25
"""Share of the scene's frame that its parts take up at first: they can move before it must change."""
SMALLEST_REACH = MOVING_MARGIN / 16.0
"""Parts that take up less of the scene's frame than this have boxes that are coarse."""
SORT_STEPS = 8
"""Steps a dynamic part by which the order is mended at a move. Any order is right; a good one is fast."""
