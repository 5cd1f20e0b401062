"""Parts of a scene: their poses, and the trees over the parts."""
