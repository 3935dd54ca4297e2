"""Merging of exposures alone: still cameras, known poses, no lens blur and no glare."""
