"""Models of the paper, with its walls, presses, energies and FIG 5."""
