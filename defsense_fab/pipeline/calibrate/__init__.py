"""From measurements on the specimen to the cord's response."""
