"""From resistances measured on bent specimens to the cord's response to strain."""
