"""A synthetic specimen like the paper's: mesh, scans before and after use, and the truth.

With it, the whole study can run, and every stage can be scored, without measured files. Its results
say something about the software, never about a stone.
"""
