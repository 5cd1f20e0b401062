"""Bodies from faces: cleaning, connection across edges, welding, nesting and orientation."""
