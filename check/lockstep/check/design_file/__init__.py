"""design.json as one type: what is claimed of a design, what proves it, and remarks, each under a key of its own."""
