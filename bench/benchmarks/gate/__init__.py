"""The regression gate: ratios of this package's times to those of a plain yardstick."""
