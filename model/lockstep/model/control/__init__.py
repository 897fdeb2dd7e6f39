"""The agent and the loop for python-control; controllability, observability and zeros of the linear part."""
