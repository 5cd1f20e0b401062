"""Experiments with people: a design in a file, its plan, sessions with a log, and their analysis.

A participant is a pseudonym. What is shown when follows from the design, its seed and the answers alone, so
that a session that was killed goes on, and a simulated one is the same on every run.
"""
