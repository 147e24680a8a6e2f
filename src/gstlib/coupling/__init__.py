"""What the macroscale gives to each patch, how sure that is, and where patches lie."""
