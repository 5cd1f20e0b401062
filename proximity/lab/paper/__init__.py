"""The models of the paper: walls, presses, energies and FIG 5."""
