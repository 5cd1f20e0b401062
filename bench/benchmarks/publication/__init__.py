"""Figures of the documentation, made from the JSON of published runs."""
