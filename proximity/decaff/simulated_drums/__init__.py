"""Simulated drums that follow a running service."""
