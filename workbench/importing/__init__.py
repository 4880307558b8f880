"""Other people's files in: profile files and poses become a recording."""
