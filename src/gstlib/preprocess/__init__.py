"""From what an instrument wrote to a surface that contact can be solved on."""
