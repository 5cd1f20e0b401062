"""Single kernels, beside a textbook's formulas."""
