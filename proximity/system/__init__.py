"""Services of the operating system: aligned memory, atomic files, locks and signals."""
