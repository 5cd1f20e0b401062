"""Parts of the commands in the parent folder: one package for each measured subject."""
