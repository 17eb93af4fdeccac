"""Record the moving surface as an animation, and write it as glTF, USD or NumPy arrays."""
