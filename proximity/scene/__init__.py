"""Solids, parts and scenes, the queries that they answer, and files made into scenes."""
