"""Model bodies, channels, parts, moulds and the specimen, and arrange parts for printing."""
