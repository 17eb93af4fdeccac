"""A recorded session processed: tags, rest frame, signals."""
