"""Experiments with people, from a design in a file to a plan, visits in CSV files, and their analysis.

A participant is a pseudonym. The stimuli depend only on the design and its seed, so that an interrupted visit
can continue, and a simulated one is the same on every run.
"""
