"""Input and output: atomic files, Parquet tables, text for terminals, free memory."""
