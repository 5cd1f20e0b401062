"""The running service: publishing, latency between processes, lateness and memory."""
