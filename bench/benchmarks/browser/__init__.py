"""Programs for Node and a page that time the engine for browsers."""
