"""The first hit of a ray with one part."""
