"""A press on a CAD part with the distance engine in the loop."""
