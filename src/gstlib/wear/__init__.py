"""How much wears, by Archard's law, fitted to the losses that were measured."""
