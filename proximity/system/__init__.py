"""What the operating system is asked for: memory, files written whole, locks and signals."""
