"""Points, boxes and triangles, as numbers or eight lanes at a time."""
