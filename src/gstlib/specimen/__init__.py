"""A synthetic specimen like the paper's: mesh, scans before and after use, and the truth.

It lets the whole study run, and every stage be scored, without measured files. Its results are
evidence about the software, never about a stone.
"""
