"""Commands that train and test models, and simulate recordings."""
