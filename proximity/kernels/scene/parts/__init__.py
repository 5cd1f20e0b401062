"""Parts of a scene: poses, and the trees over the parts."""
