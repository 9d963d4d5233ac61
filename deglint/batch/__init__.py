"""Many scenes with one recipe: what is to be done with each, and processes that do it."""
