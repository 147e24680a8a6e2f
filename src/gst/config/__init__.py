"""What a user writes, read and checked: the config and its tables."""
