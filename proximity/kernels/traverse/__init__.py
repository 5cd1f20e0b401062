"""The only loops over trees; queries give them what to do at a node and at a leaf."""
