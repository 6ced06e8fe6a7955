"""What Python and notebooks get: questions as functions, answers that show themselves, still figures of each."""
