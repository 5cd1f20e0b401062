"""Single kernels, compared with textbook formulas."""
