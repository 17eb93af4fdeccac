"""Turn marker positions into named controls: how far the device is bent, twisted or pulled."""
