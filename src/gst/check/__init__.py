"""Every file of a study read before any work: what it holds, what is wrong, what cures it."""
