"""Benchmarks and the project's goals; every error and every time is a row of one schema."""
