"""Benchmarks and the project's goals: every error and every time in one schema of rows."""
