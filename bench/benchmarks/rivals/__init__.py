"""Other libraries that answer the same questions, each behind one interface, and this package beside them."""
