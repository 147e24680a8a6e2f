"""Results for others: compared, exported, packed; and one scan pressed alone."""
