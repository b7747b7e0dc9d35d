"""What every controller that learns by driving has in common: contract, training, results."""
