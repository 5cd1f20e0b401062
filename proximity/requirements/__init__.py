"""Requirements of an assembly in a file next to the model: gaps and clashes, verified with bounds.

`verification.verify` reads the file, measures the parts and gives each requirement a verdict. A receipt
records the verdicts with the hashes of all files, and can be checked without the author.
"""
