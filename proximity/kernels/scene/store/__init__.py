"""Scenes stored in files: checksums, validation, completion."""
