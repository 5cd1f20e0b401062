"""Kernels of the shortest connection between two parts."""
