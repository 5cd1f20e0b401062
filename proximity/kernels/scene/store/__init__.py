"""Scenes stored in files: their checksums, their validation, and the computation of derived values."""
