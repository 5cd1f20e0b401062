"""Arrays that the kernels read: the tree of a part, the parts of a scene, copies for a moving scene."""
