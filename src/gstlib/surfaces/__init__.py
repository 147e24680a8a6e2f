"""Heights on a grid: levelled, filtered, and where they lie."""
