"""What one agent is: its equations, their parts, the split of (2), and how agents may differ."""
