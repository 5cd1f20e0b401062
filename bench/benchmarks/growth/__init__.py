"""How costs grow with faces, parts, points and distance."""
