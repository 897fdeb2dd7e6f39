"""The certificate in continuous time: one inequality over a list of channels, on the whole network, by modes or on a box."""
