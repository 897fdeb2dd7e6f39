"""What is asked for where a problem says nothing, and one attempt after the other until gains are near their floor."""
