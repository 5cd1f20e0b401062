"""Arrays that the kernels read: trees of parts, scenes of parts, and copies for scenes whose parts move."""
