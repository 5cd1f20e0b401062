"""Experiments with people: a design in a file, its plan, visits in CSV files, and their analysis.

A participant is a pseudonym. The stimuli follow from the design and its seed alone, so an interrupted visit
can continue, and a simulated one is the same on every run.
"""
