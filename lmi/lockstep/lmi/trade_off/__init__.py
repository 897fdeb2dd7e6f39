"""What rho costs: other gains between which to choose, and one design's rho against alpha."""
