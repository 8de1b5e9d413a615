"""What a robot has to achieve."""
