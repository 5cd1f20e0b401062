"""Compiled scenes: files that are mapped into memory and validated, without building trees again."""
