"""Studies: a job for every condition of a table, on all cores of one machine or many.

study file → conditions → tasks on Ray → rows in Parquet and CSV → figure
"""
