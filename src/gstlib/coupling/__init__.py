"""Macroscale values of each patch, their uncertainty, and checks of the positions of patches."""
