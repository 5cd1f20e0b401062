"""Triangle meshes: faces by vertex index, how they meet, and what is wrong with them."""
