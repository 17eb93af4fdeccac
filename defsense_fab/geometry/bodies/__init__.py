"""A device's body: loaded, repaired, meshed, with its connector bay and tags."""
