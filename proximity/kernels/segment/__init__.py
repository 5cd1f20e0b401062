"""The shortest connection between a segment and one part."""
