"""What a file of a foreign logger holds: its layout, its columns, what each of them may be, and the column map that follows."""
