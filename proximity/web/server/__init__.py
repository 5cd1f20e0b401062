"""Serving a page: who may come in, its files over HTTP, and one live connection for each page."""
