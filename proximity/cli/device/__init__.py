"""Commands for gloves, drums and motors."""
