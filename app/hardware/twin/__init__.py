"""A digital twin of the station: a simulated arm behind the robot's own protocol, and a simulated cloth and camera."""
