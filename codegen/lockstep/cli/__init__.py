"""The command line: it parses, calls the door and prints."""
