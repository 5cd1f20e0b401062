"""Pages and tables of the commands in `proximity.cli.parts`."""
