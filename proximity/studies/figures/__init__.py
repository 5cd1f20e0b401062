"""Plots of the studies."""
