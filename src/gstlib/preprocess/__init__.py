"""From an instrument's file to a surface on which contact can be solved."""
