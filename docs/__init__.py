"""The pages of the documentation, and `docs.made`: the parts of them that are made from the program."""
