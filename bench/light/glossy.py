"""Glossy light: error by look-ups with and without lights, energy."""
