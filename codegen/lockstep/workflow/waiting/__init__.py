"""What is said while something is computed: how far it is, and how long it may still take."""
