"""The paper: its claims, each with a verdict, and its Section 4 again."""
