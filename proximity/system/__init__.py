"""Services of the operating system, such as aligned memory, atomic files, locks and signals."""
