"""Commands that design a device and make its parts."""
