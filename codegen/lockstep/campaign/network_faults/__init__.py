"""Campaigns of network faults: the nodes that ship, on a network that loses, delays, repeats, reorders and corrupts."""
