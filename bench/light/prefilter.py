"""Sets of prefiltered levels for other renderers, against cmft and cmgen."""
