"""Commands that run a service, listen to it, and serve programs at its other end."""
