"""Process many scenes with one recipe: the list of jobs, and the worker processes that run them."""
