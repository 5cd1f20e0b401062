"""Inputs of a service, which receive poses, motions of parts, and measured distances."""
