"""Read and check the files that a user writes: the config and its tables."""
