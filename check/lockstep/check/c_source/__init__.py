"""A controller read from its generated C: its numbers, and that the rest is the code that computes with them."""
