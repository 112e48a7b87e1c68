"""What is estimated while robots drive: where they are, and how they answer to commands."""
