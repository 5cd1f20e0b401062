"""Inside or outside of one part: winding number, pseudo-normals, and a grid of classified cells."""
