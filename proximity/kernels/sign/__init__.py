"""Decision between inside and outside of one part, by winding numbers, pseudo-normals or a grid of cells."""
