"""What a run gives: the trajectory, its indices, and tables and files of it."""
