"""Simulation of hand, finger, wall and drum in closed loop."""
