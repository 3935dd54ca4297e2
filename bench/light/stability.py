"""Seams, steadiness, extremes, rotation and mirror."""
