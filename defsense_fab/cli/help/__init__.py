"""Commands about the program itself: dependencies, licenses, completion."""
