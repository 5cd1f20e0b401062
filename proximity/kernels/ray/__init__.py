"""First hit of a ray with one part."""
