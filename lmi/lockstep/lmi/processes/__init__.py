"""How a search runs: threads of linear algebra, processes of one machine, and a cluster."""
