"""Presentation of answers: tables, labelled lines, JSON and CSV."""
