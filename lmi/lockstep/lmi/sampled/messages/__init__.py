"""Witnesses for what a network does to messages, and how much of each fault is certified."""
