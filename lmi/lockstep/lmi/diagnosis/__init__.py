"""Why no gains were found, what would help, and the trade-off curve."""
