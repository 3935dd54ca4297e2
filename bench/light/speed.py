"""Rebuilding, updating and converting maps, in yardsticks."""
