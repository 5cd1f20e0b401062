"""Studies, which run a job for every condition of a table on all cores of one or many machines.

study file → conditions → tasks on Ray → rows in Parquet and CSV → figure
"""
