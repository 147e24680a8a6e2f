"""The contact of each patch at the resolution of its scan."""
