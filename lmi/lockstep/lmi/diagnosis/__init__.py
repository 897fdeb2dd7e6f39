"""Why no gains were found, what would help, and what agents do without controllers."""
