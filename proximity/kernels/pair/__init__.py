"""Kernels for the shortest connection between two parts."""
