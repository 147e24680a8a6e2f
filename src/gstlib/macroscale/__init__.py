"""The face of the stone, the active tool on it, and their equilibrium."""
