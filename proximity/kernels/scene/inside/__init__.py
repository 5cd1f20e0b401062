"""Which parts contain a point, and how deep it is in them."""
