"""From recorded sessions to a trained model, and what its errors are."""
