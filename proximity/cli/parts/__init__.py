"""Commands that ask and show parts."""
