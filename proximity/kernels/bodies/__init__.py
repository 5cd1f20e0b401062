"""Splitting of faces into bodies: cleaning, connection across edges, welding, nesting and orientation."""
