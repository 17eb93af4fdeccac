"""The twin's cameras: pictures and films of a scene, with the truth about them."""
