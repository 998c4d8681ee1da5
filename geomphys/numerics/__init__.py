"""Vectors, transforms, rates of motion and quantiles."""
