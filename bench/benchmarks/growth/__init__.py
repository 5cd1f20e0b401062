"""Growth of costs with faces, parts, points and distance."""
