"""Positions, edges, faces and connected components of a mesh."""
