"""Inputs of a service: poses, motions of parts, and measured distances."""
