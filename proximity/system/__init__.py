"""Services of the operating system: aligned memory, files written whole, locks and signals."""
