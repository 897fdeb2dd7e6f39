"""The sampled, rounded loop as one discrete inequality, in doubles, rationals or balls."""
