"""Server of a page: access control, its files over HTTP, and one live connection for each page."""
