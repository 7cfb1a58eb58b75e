"""What every node shares: messages, parameters, quality of service, tile flow control."""
