"""Latency certificate of a scene, which compares the cost of ticks at its worst positions with a period.

    file → subject → worst positions → measurement (ticks, loop) → verdict → report (text, JSON, picture)

The search maximises work, which is the same on every run; only the final measurement depends on time.
"""
