"""Inference of the load case from the wear of a tool."""
