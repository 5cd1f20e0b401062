"""How answers are shown: tables, labelled lines, JSON and CSV."""
