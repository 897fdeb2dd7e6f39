"""Who listens to whom: graphs in full, and large ones sparsely with the interval that their spectrum lies in."""
