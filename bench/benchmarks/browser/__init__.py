"""What Node and a page run to time the engine for browsers."""
