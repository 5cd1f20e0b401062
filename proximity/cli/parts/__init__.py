"""Commands that query and show parts."""
