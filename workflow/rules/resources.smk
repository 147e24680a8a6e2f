# What a job asks a cluster for: memory and time, from the sizes of the files that it reads.
# The figures are measured ones with a margin; docs/cluster.md has both. A run on one machine heeds
# neither.

import os


def megabytes(files):
    """Size (MB) of each file that is there; within a group of jobs, inputs are still to be made."""
    return [os.path.getsize(file) / 1e6 for file in files if os.path.exists(file)]


def memory_mb(wildcards, input, attempt):
    """Resource function for work on one patch after the other: 700 MB, and 50 times the largest input.

    Of these, 300 MB are for the two Snakemakes around every job on a cluster, 100 to 250 for
    Python's libraries. A second attempt is given twice as much.
    """
    return attempt * round(700 + 50 * max(megabytes(input), default=0))


def memory_of_all_mb(wildcards, input, attempt):
    """Resource function for work that holds all patches at once: 4 times their files besides."""
    return memory_mb(wildcards, input, attempt) + attempt * round(4 * sum(megabytes(input)))


def minutes(wildcards, input, attempt):
    """Resource function: 10 minutes, and one for each 20 MB of input; twice at a second attempt."""
    return attempt * round(10 + sum(megabytes(input)) / 20)
