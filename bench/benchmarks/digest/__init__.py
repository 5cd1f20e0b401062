"""Digests of answers: the public interface is asked, and the raw bytes of what it returns are hashed."""
