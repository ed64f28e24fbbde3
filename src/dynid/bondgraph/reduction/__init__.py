"""From a graph to a prototype at the port of interest: the reduction as a program of physical steps."""
