"""The figures of a study: what its samples were, what they gave, and what that depends on.

However many samples there are, a figure stays small: what is drawn of each sample is thinned out evenly, or
counted in bins. Statistics, correlations and indices are of all samples.
"""
