"""The face of the stone, what is pressed on it, and how it comes to rest."""
