"""The step Body: the body and its parameters, materials, and fields of the device."""
