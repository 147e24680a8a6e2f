"""Heights on a grid: levelling, filtering and positions."""
