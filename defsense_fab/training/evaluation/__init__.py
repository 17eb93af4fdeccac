"""How good a trained model is on frames that it was not trained on, and why not better."""
