"""Triangle meshes: faces by vertex index, their connections and defects."""
