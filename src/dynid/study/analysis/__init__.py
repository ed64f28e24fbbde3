"""What a study says: statistics, influence of the inputs, expectations, the worst sample."""
