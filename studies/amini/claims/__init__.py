"""The claims of the paper, each tried and judged."""
