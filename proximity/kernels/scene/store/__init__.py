"""A scene in a file: checksums, validation, completion."""
