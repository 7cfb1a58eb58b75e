"""Method `bidirectional_slope`: profiles walked forth and back."""
