"""Digests of answers: the raw bytes returned by the public interface are hashed."""
