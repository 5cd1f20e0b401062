"""The drum's controller as C99 sources for a microcontroller."""
