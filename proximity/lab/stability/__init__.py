"""Stability of sampled and delayed walls."""
