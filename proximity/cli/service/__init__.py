"""Commands that run a service, read its frames, and write sources for its clients."""
