"""Changes to a device's file, by what they mean."""
