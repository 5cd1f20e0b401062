"""What the commands in this folder's parent are made of: one package for each thing that is measured."""
