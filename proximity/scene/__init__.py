"""Solids, parts and scenes, the queries that they answer, and the loading of files as scenes."""
