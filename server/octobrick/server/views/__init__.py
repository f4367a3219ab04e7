"""What someone looks at, in the words that the command line and the service share."""
