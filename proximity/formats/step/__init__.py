"""STEP files."""
