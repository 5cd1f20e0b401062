"""Parts that contain a point, and its depth in them."""
