"""Bond graphs, block diagrams and structures as drawings, laid out without overlaps."""
