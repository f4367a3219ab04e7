"""How the service is run: processes, connections, logs and numbers."""
