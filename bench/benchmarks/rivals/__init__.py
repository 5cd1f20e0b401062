"""Contenders: other libraries with the same queries, each behind one interface, and this package."""
