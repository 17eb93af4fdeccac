"""The mode in which the device is optimised and built."""
