"""A study as Snakemake runs it: its jobs, their logs, and the record of each step."""
