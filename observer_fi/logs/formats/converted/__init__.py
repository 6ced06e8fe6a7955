"""What is no table of text with a row a sample yet: made into one, between tabs, for the reader of such tables."""
