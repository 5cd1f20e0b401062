"""Faces made into bodies: cleaned, connected across edges, welded, nested and turned."""
