"""Tree traversals; queries provide the functions for nodes and leaves."""
