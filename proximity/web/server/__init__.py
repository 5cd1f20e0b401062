"""Server of a page, with access control, files over HTTP, and one live connection for each page."""
