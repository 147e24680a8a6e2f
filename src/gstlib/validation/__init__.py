"""Comparison of the predicted with the measured loss, and of one scale with two."""
