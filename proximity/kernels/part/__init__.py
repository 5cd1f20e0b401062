"""A single part as a separate model, with its sign. The caller provides the memory."""
