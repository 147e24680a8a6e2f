"""How a tool was used, read from its wear."""
