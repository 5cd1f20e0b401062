"""The core without Python: the library in C, what is generated for it, and how it is written out."""
