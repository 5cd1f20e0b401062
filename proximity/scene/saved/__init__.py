"""Compiled scenes: files that are mapped into memory and checked, not built again."""
