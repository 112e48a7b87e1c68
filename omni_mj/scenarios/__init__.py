"""What is simulated: settings, scenarios and their library, and finding controllers, plants and robots by name."""
