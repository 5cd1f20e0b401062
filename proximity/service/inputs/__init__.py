"""Where a service gets poses, part motions and measured distances from."""
