"""Compiled kernels: plain numbers in, plain numbers out. No classes, files or exceptions."""
