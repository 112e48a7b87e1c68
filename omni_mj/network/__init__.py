"""What is between robots and team: camera and radio, and what faults do to them."""
