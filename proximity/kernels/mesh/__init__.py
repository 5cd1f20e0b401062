"""Edges, faces and connected components of a mesh."""
