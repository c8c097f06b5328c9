"""The search for parameters that suit given recordings."""
