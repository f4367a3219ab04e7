"""Pictures over HTTP: the queue, and the processes that render."""
